"""What moves a virtual robot: its own joint-by-joint physics, or a rigid-body engine's."""
