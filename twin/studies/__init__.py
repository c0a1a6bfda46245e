"""Sensor placement studies: search by coverage and tracking, validate the best placement, plan its installation."""
