# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Table of the views on the page of a lane or of a recorded shift."""

from checkweigher_web.technician.practice import PracticeView
from checkweigher_web.views.alarms import AlarmsView
from checkweigher_web.views.control_charts import MeansView, SpreadsView
from checkweigher_web.views.diagnostics import DiagnosticsView
from checkweigher_web.views.empty_belt import EmptyBeltView
from checkweigher_web.views.faults import FaultsView
from checkweigher_web.views.hour import HourView
from checkweigher_web.views.item import ItemView
from checkweigher_web.views.item_list import ItemListView
from checkweigher_web.views.masses import MassesView
from checkweigher_web.views.production import ProductionView
from checkweigher_web.views.signal import SignalView
from checkweigher_web.views.view import View

# Views in the order of the page, by the CSS class of their panels.
VIEWS: dict[str, type[View]] = {
    'item': ItemView,
    'practice': PracticeView,
    'hour': HourView,
    'signal': SignalView,
    'list': ItemListView,
    'alarms': AlarmsView,
    'faults': FaultsView,
    'production': ProductionView,
    'masses': MassesView,
    'means': MeansView,
    'spreads': SpreadsView,
    'belt': EmptyBeltView,
    'diagnostics': DiagnosticsView,
}
