"""The closed loop on analytic plants and in MuJoCo."""
