"""The rig of a bag: topics of its sensors, transforms, checks of a rig against it, and a guess where there is none."""
