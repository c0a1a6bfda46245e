"""`twin reproduce fusion`: one tracker on all sensors, beside the published systems on their own grounds."""
