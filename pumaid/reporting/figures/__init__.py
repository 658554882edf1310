"""Figures of models, residuals, diagnoses, logs and plans, drawn by matplotlib."""
