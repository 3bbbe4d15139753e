# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The estimators: from a weigh window to the load, selectable by name.

In the examples of the classes ``window`` is a denoised WeighWindow with a load of 0.2 kg.
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
from checkweigher_dsp.estimation.estimators.tvlpf import Tvlpf

# In the order of the number of learned parameters, fewest first. If two are equally good, `tune`
# prefers the simpler one.
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
