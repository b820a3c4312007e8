"""Values of other statistics packages for the tests of `survival`, `exact`, `holm`, `effect` and `kruskal_wallis`.

    python -m venv venv && venv/bin/pip install scipy==1.17.1 statsmodels==0.15.0 lifelines==0.30.3
    venv/bin/python statistics.py
"""

import numpy as np
from lifelines import KaplanMeierFitter
from lifelines.statistics import multivariate_logrank_test
from lifelines.utils import restricted_mean_survival_time
from scipy import optimize, stats
from statsmodels.stats.contingency_tables import mcnemar
from statsmodels.stats.multitest import multipletests

# Times and whether they are events. `A` and `B`: the remission times of Freireich et al., Blood
# 21, 1963.
A = ([6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35],
     [1, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0])
B = ([1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23], [1] * 21)
C = ([3, 9, 9, 14, 30, 30, 30, 30], [1, 1, 1, 1, 0, 0, 0, 0])


def survival():
    for name, (times, events) in {"A": A, "C": C}.items():
        fitted = KaplanMeierFitter().fit(times, events)
        horizon = 30
        mean, variance = restricted_mean_survival_time(fitted, t=horizon, return_variance=True)
        print(name, "survival at 10", fitted.predict(10), "at 23", fitted.predict(23))
        print(name, "interval at 10", fitted.confidence_interval_.loc[10 if 10 in fitted.confidence_interval_.index else 9].tolist())
        # lifelines integrates t S(t) for the variance of min(T, horizon), not of its estimate; so
        # Greenwood's formula for the area is written out here.
        table = fitted.event_table.loc[1:]
        table = table[table.observed > 0]
        grid = [t for t in table.index if t < horizon] + [horizon]
        curve = [fitted.predict(t) for t in grid]
        area = lambda i: sum(curve[j] * (grid[j + 1] - grid[j]) for j in range(i, len(grid) - 1))
        greenwood = sum(
            area(i) ** 2 * table.observed.iloc[i] / (table.at_risk.iloc[i] * (table.at_risk.iloc[i] - table.observed.iloc[i]))
            for i in range(len(grid) - 1)
        )
        print(name, "restricted mean", mean, "standard error", greenwood ** 0.5)
    for groups in ([A, B], [A, B, C]):
        times = np.concatenate([g[0] for g in groups])
        events = np.concatenate([g[1] for g in groups])
        labels = np.concatenate([[i] * len(g[0]) for i, g in enumerate(groups)])
        found = multivariate_logrank_test(times, labels, events)
        print("log-rank", len(groups), "groups", found.test_statistic, found.p_value)
    for x, k in [(0.5, 1), (3.841458820694124, 1), (16.79, 1), (2.0, 2), (7.5, 3), (0.2, 5), (40.0, 7)]:
        print("chi-squared tail", x, k, stats.chi2.sf(x, k))


def exact():
    for b, c in [(9, 2), (0, 5), (5, 0), (6, 6), (40, 18), (0, 0), (600, 500)]:
        print("mcnemar", b, c, mcnemar([[0, b], [c, 0]], exact=True).pvalue if b + c else 1.0)
    for table in ([8, 2, 1, 5], [30, 0, 7, 23], [3, 27, 9, 21], [0, 30, 0, 30], [930, 70, 93, 7], [100, 0, 97, 3]):
        print("fisher", table, stats.fisher_exact(np.reshape(table, (2, 2))).pvalue)
    p = [0.01, 0.04, 0.03, 0.005]
    print("holm", multipletests(p, method="holm")[1])
    p = [0.5, 0.02, 0.3, 0.02, 0.9]
    print("holm", multipletests(p, method="holm")[1])


def effect():
    def interval(x, y):
        x, y = np.array(x, float), np.array(y, float)
        m, n = len(x), len(y)
        value = stats.mannwhitneyu(x, y).statistic / (m * n)
        middle = (m + n) / 2 - 1
        z = stats.norm.ppf(0.975)
        variance = lambda t: t * (1 - t) * (1 + middle * ((1 - t) / (2 - t) + t / (1 + t))) / (m * n)
        low = 0.0 if value == 0 else optimize.brentq(lambda t: value - t - z * variance(t) ** 0.5, 1e-15, value - 1e-9)
        high = 1.0 if value == 1 else optimize.brentq(lambda t: t - value - z * variance(t) ** 0.5, value, 1 - 1e-15)
        return value, low, high

    print("a12", interval([1, 4, 7, 9, 9, 12], [2, 4, 5, 6]))
    print("a12", interval([5, 6, 7], [1, 2, 3, 4]))
    print("a12", interval([300] * 20 + list(range(10, 110, 10)), [300] * 5 + list(range(1, 26))))


def kruskal_wallis():
    print("kruskal", stats.kruskal([2.9, 3.0, 2.5, 2.6, 3.2], [3.8, 2.7, 4.0, 2.4], [2.8, 3.4, 3.7, 2.2, 2.0]))
    print("kruskal", stats.kruskal([1, 1, 2, 5], [2, 2, 3], [7, 7, 8, 9], [5, 1]))


survival()
exact()
effect()
kruskal_wallis()
