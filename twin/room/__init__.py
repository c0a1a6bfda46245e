"""The room: its walls, floor and furniture, where one may walk and where sensors can hang."""
