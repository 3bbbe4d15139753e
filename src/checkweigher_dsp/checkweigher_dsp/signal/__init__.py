"""Mathematics that several stages use: averages, autoregression, Kalman filter, platform."""
