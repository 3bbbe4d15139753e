# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimators of the load in a weigh window, which are selected by name.

In the examples of the classes, ``window`` is a denoised `WeighWindow` with a load of 0.2 kg.
"""

from checkweigher_dsp.estimation.estimators.aeksi import Aeksi
from checkweigher_dsp.estimation.estimators.aid import Aid
from checkweigher_dsp.estimation.estimators.averages import Hann, Mean
from checkweigher_dsp.estimation.estimators.base import Estimator
from checkweigher_dsp.estimation.estimators.fir_model import FirModel
from checkweigher_dsp.estimation.estimators.gauss_markov import GaussMarkov
from checkweigher_dsp.estimation.estimators.iswd_eksi import IswdEksi
from checkweigher_dsp.estimation.estimators.iswd_eksi_paper import IswdEksiPaper
from checkweigher_dsp.estimation.estimators.learned import Learned
from checkweigher_dsp.estimation.estimators.lms_notch import LmsNotch
from checkweigher_dsp.estimation.estimators.tvlp_mf import TvlpMf
from checkweigher_dsp.estimation.estimators.tvlpf import Tvlpf

# The estimators are sorted from simple to complex. If a simpler estimator is only negligibly less
# accurate than the most accurate one, the command `tune` selects the simpler one.
ESTIMATORS: dict[str, type[Estimator]] = {
    'mean': Mean,
    'hann': Hann,
    'iswd_eksi_paper': IswdEksiPaper,
    'tvlpf': Tvlpf,
    'aid': Aid,
    'aeksi': Aeksi,
    'iswd_eksi': IswdEksi,
    'fir_model': FirModel,
    'gauss_markov': GaussMarkov,
    'learned': Learned,
}
# Methods of the literature that only the command `evaluate` offers, for comparison with
# `ESTIMATORS`.
REFERENCES: dict[str, type[Estimator]] = {'tvlp_mf': TvlpMf, 'lms_notch': LmsNotch}
METHODS = ESTIMATORS | REFERENCES
