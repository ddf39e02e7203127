"""Where everything is in a frame: title bar, pictures side by side, plots below."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

# Parts of a frame's height, from the top; the plots have the rest.
_TITLE, _LABEL, _PICTURE = 0.068, 0.046, 0.50
_GAP = 2
PLOTS = 3


class Box(NamedTuple):
    """A rectangle of pixels; rows count from the top."""

    left: int
    top: int
    width: int
    height: int

    @property
    def right(self) -> int:
        """First column beyond it."""
        return self.left + self.width

    @property
    def bottom(self) -> int:
        """First row beyond it."""
        return self.top + self.height

    @property
    def pixels(self) -> tuple[slice, slice]:
        """Its rows and columns, to index a frame with."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


@dataclass(frozen=True)
class Layout:
    """The rectangles of a frame, by its size in pixels and the number of its pictures."""

    width: int
    height: int
    pictures: int

    @property
    def font(self) -> float:
        """Size of ordinary text, in pixels."""
        return min(self.height / 40, self.width / 66)

    @property
    def title(self) -> Box:
        """The title bar, with the clock at its right end."""
        return Box(0, 0, self.width, round(_TITLE * self.height))

    @property
    def clock(self) -> Box:
        """The part of the title bar that the clock has to itself."""
        width = round(13.5 * self.font)
        return Box(self.width - width, 0, width, self.title.height)

    def label(self, index: int) -> Box:
        """The strip above a picture, with the controller's name."""
        picture, height = self.picture(index), round(_LABEL * self.height)
        return Box(picture.left, self.title.height, picture.width, height)

    def picture(self, index: int) -> Box:
        """A picture; all have the same size."""
        width = (self.width - _GAP * (self.pictures - 1)) // self.pictures
        top = self.title.height + round(_LABEL * self.height)
        return Box(index * (width + _GAP), top, width, round(_PICTURE * self.height))

    def plot(self, index: int) -> Box:
        """A plot, with its axes' numbers and title."""
        width, top = self.width // PLOTS, self.picture(0).bottom
        return Box(index * width, top, width, self.height - top)
