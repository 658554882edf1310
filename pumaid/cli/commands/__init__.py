"""What ``pumaid`` can be told, by the step of the work; commands import what is heavy inside their functions."""
