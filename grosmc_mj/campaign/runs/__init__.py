"""Running a family: parts, their folder and manifest, the meters, and the replay of one run."""
