"""Run as a program: render a small picture with the backend in MUJOCO_GL and check it.

Prints ``renderer: ...``, OpenGL's name of the renderer; ends with an error if the picture is wrong.
"""

from __future__ import annotations

import sys

import mujoco

# A vermilion ball before a blue sky.
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

if __name__ == "__main__":
    from OpenGL import GL

    model = mujoco.MjModel.from_xml_string(_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 48, 64) as renderer:
        renderer.update_scene(data, "eye")
        picture = renderer.render().astype(int)
        name = GL.glGetString(GL.GL_RENDERER) or b"unknown"
    ball, sky = picture[24, 32], picture[4, 4]
    if not (ball[0] > 150 > ball[2] and sky[2] > 150 > sky[0]):
        raise RuntimeError(f"it renders a ball of colour {ball} before a sky of colour {sky}")
    sys.stdout.write(f"renderer: {name.decode()}\n")
