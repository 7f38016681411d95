"""The page of what a meter has counted of anybody's application."""
