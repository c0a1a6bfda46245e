"""A pose for every scan: of scanners that stand, that odometry tells, or that scan matching finds."""
