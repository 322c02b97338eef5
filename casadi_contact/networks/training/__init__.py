"""Fitting networks to samples: batch Levenberg-Marquardt, stopping, growth, checkpoints (§2.6)."""
