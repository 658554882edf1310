"""Linear algebra and statistics that know no robot."""
