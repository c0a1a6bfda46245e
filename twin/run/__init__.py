"""Running a scenario, replaying a recording, and what either leaves in its folder."""
