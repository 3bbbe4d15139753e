# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Denoising of weigh windows by stationary wavelet shrinkage."""
