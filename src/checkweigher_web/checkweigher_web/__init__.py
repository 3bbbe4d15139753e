# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Web page for operators and technicians at the line."""

ADDRESS = '127.0.0.1'
PORT = 8080
