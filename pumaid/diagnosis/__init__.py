"""What a model still gets wrong and which physics is missing: statistics on cells, never on the logs."""
