"""Fitting networks to samples: batch Levenberg-Marquardt, stopping, growth, checkpoints ([EF15 §2.6])."""
