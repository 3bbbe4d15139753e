# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Languages of the page, each in a catalogue ``NAME.po``, and texts in plain words."""
