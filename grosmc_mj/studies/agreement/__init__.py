"""Do the equations and MuJoCo agree, to rounding?"""
