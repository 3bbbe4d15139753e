# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Languages of the page, each with a catalogue ``NAME.po``, and plain texts for messages."""
