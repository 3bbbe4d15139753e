# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from made_procedure import CELL
import pytest

from checkweigher_driver.calibration.session import CalibrationSession
from checkweigher_driver.calibration.static_calibration import CalibrationError, Steadiness
from checkweigher_web.languages.wording import in_words


def test_a_message_of_a_node_becomes_what_to_do():
    with pytest.raises(CalibrationError) as raised:
        CalibrationSession(CELL, Steadiness()).finish(0.0, (), 0, 0.0)
    assert in_words(str(raised.value)) == 'Read the empty belt and a known mass first.'
    assert in_words('busy: tvlpf on 3 bags; wait, or cancel it').startswith('Another recording')


def test_a_message_that_is_not_known_stays_with_its_masses_in_g():
    assert in_words('the zero moved by -0.0125 kg: too far') == 'the zero moved by -12.5 g: too far'
