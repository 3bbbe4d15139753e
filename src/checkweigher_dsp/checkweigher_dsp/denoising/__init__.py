"""Denoising of weigh windows by stationary wavelet shrinkage."""
