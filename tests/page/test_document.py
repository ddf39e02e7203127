"""JSON documents: what stands for infinity, one record of versions, whole or not there."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np
import pytest

from grosmc_mj.errors import SetupError
from grosmc_mj.results.document import json_text, origin, write_json
from grosmc_mj.versions import versions


def test_null_stands_for_every_number_that_json_has_not() -> None:
    content = MappingProxyType(
        {
            "margins": [math.inf, -math.inf, (math.nan, 1.5)],
            "numpy": {"value": np.float64(-math.inf), "runs": np.int64(3), "kept": np.bool_(True)},
            "text": "inf",
        }
    )
    assert json.loads(json_text(content)) == {
        "margins": [None, None, [None, 1.5]],
        "numpy": {"value": None, "runs": 3, "kept": True},
        "text": "inf",
    }


def test_numbers_survive_to_the_last_bit(tmp_path: Path) -> None:
    values = [0.1, 5e-324, -0.0, 1e308, float(np.nextafter(1.0, 2.0))]
    write_json(tmp_path / "new" / "a.json", values)
    read = json.loads((tmp_path / "new" / "a.json").read_text(encoding="utf-8"))
    assert np.array(read).tobytes() == np.array(values).tobytes()


def test_what_cannot_be_written_as_json_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_json(path, {"value": object()})
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(SetupError, match="cannot write"):
        write_json(path / "b.json", {})


def test_origin_says_which_code_and_seed() -> None:
    found = origin(7, 2)
    assert (found["seed"], found["schema_version"], origin(None)["schema_version"]) == (7, 2, 1)
    assert found["versions"]["mujoco"] == mujoco.__version__
    assert found["git_revision"] is None or len(found["git_revision"].partition("-")[0]) == 40
    assert versions(["no-such-package"]) == {"no-such-package": "not installed"}
