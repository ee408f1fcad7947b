#!/usr/bin/env python3
"""Sidak's correction: from which |z| one of m tests fails, as curves of pgfplots.

usage: sidak.py > sidak.tex

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
from math import expm1, log1p
from statistics import NormalDist

for alpha in (0.01, 1e-4):
    points = ''
    for tests in (10 ** (k / 4) for k in range(33)):
        one = -expm1(log1p(-alpha) / tests)
        points += f' ({tests:.4g},{-NormalDist().inv_cdf(one / 2):.4f})'
    print(f'\\addplot[black] coordinates {{{points} }};')
