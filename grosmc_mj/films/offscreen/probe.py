"""Run as a program: render one small frame with the backend in MUJOCO_GL and look at it.

Prints one line of JSON: ``{"renderer": ...}`` if the picture is right, else ``{"error": ...}``.
"""

from __future__ import annotations

import json
import os

# A vermilion ball before a blue sky: both must be seen.
_MODEL = """
<mujoco>
  <asset>
    <texture type="skybox" builtin="flat" rgb1="0 0 1" rgb2="0 0 1" width="8" height="48"/>
  </asset>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="eye" pos="0 -3 0" xyaxes="1 0 0 0 0 1" fovy="45"/>
    <geom type="sphere" size="0.5" rgba="1 0.2 0 1"/>
  </worldbody>
</mujoco>
"""


def look() -> str:
    """Render the scene, check it, and say what OpenGL calls its renderer.

    Raises:
        RuntimeError: If the picture is not the scene.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 48, 64) as renderer:
        renderer.update_scene(data, "eye")
        picture = renderer.render().astype(int)
        from OpenGL import GL

        name = GL.glGetString(GL.GL_RENDERER)
    if not picture.any():
        raise RuntimeError("it renders black frames")
    ball, sky = picture[24, 32], picture[4, 4]
    if not (ball[0] > 150 > ball[2] and sky[2] > 150 > sky[0]):
        raise RuntimeError(f"it renders a ball of colour {ball} before a sky of colour {sky}")
    return name.decode() if isinstance(name, bytes) else "unknown"


def main() -> None:
    """Print what ``look`` found."""
    # What libraries print must not be taken for the answer.
    answer = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    try:
        found = {"renderer": look()}
    except Exception as error:
        found = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    print(json.dumps(found), file=answer, flush=True)


if __name__ == "__main__":
    main()
