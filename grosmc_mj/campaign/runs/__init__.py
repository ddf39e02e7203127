"""Running a family: its parts, screened or not, their folder and manifest, and replays."""
