"""The room: walls, floor and furniture, walkable area, and mounting places for sensors."""
