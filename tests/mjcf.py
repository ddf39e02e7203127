"""Robots as tests read them: trees of hinges and slides, drives with lags and delays, couplings."""

from __future__ import annotations

# A branched tree on a stand, with all that belongs to the nominal dynamics: armature, damping, a
# spring and bodies that do not move against their parents.
TREE = """
<mujoco model="tree">
  <option timestep="0.001"/>
  <worldbody>
    <body name="stand" pos="0 0 1"><geom type="box" size="0.1 0.1 0.02" mass="3" contype="0"
      conaffinity="0"/>
    <body name="base">
      <joint name="turn" axis="0 0 1" damping="0.3" armature="0.2"/>
      <geom type="box" size="0.1 0.2 0.05" mass="2"/>
      <body name="boom" pos="0.2 0 0">
        <joint name="lift" axis="0 -1 0" damping="0.1" stiffness="3" springref="0.4"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0.1" size="0.03" mass="1.5"/>
        <body name="tool" pos="0.3 0.1 0" euler="20 30 0">
          <geom type="ellipsoid" size="0.05 0.1 0.07" mass="0.7"/>
        </body>
      </body>
      <body name="tray" pos="-0.1 0.1 0">
        <joint name="push" type="slide" axis="0 1 1" armature="0.1"/>
        <geom type="box" size="0.1 0.02 0.03" pos="0 0 0.1" mass="0.9"/>
      </body>
    </body></body>
  </worldbody>
  <actuator>
    <motor name="push_force" joint="push" gear="-20" ctrlrange="-1 0.5"/>
    <position name="turn_servo" joint="turn" kp="50" kv="5" forcerange="-30 30"/>
    <velocity name="lift_servo" joint="lift" kv="9"/>
  </actuator>
</mujoco>
"""

# One link; holes for more of its joint, and for its actuator.
ONE = """<mujoco model="one"><option timestep="0.001" integrator="RK4"/>
<worldbody><body name="link"><joint name="hinge" axis="0 1 0" damping="0.1"{}/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""
LAG = (
    '<general name="drive" joint="hinge" dyntype="filterexact" dynprm="0.02" gainprm="4" gear="-2" '
    'ctrlrange="-3 5"/>'
)
DELAY = '<motor name="drive" joint="hinge" gear="2" ctrlrange="-10 10" delay="0.012" nsample="15"/>'

# Two links beside each other; holes for the second one's motor and for couplings.
TWO = """<mujoco model="two"><option timestep="0.001" integrator="implicitfast"/><worldbody>
<body name="a"><joint name="first" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.5" mass="1"/></body>
<body name="b" pos="0 1 0"><joint name="second" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.3" mass="2"/></body></worldbody>
<actuator><motor name="one" joint="first"/>{}</actuator><equality>{}</equality></mujoco>"""
SECOND = '<motor name="two" joint="second"/>'
COUPLED = '<joint joint1="first" joint2="second" polycoef="0 2 0 0 0" {}/>'
STIFF, COMPLIANT = COUPLED.format(""), COUPLED.format('solref="-40 -2"')

# More contacts with the floor than the memory holds, which MuJoCo calls an error.
CROWDED = f"""
<mujoco>
  <size memory="40k"/>
  <worldbody>
    <geom type="plane" size="9 9 1"/>
    <body pos="0 0 .1"><joint name="fall" type="slide" axis="0 0 1"/>{
    "".join(f"<geom type='box' size='.04 .04 .04' pos='{i / 10} 0 0'/>" for i in range(64))
}</body>
  </worldbody>
  <actuator><motor name="fall" joint="fall"/></actuator>
</mujoco>
"""
