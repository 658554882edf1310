"""What a model still gets wrong and which physics is missing: statistics on bins, never on the logs."""
