"""Load cells on serial ports."""
