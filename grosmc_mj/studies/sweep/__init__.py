"""Many runs as one table: a design has a row a run, the result adds metrics, margins, status."""
