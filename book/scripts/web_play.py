"""Figures to play with, for web.py: their data, from which web.js makes them.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import html
import json
import os
import re
import shutil


def curves(files, _):
    """The panels of efficiency-curves.tex: a title, and the runs' points."""
    return [{'title': ', '.join(title.replace('$\\rho=', 'ρ = ').rstrip('$')
                                .split(', ')),
             'runs': [[tuple(map(float, p)) for p in
                       re.findall(r'\(([^,()]*),([^,()]*)\)', run)]
                      for run in re.findall(r'coordinates \{(.*?)\}', body)]}
            for title, body in re.findall(
                r'\\begin\{panel\}\{(.*?)\}\n(.*?)\\end\{panel\}',
                open(files['efficiency-curves.tex']).read(), re.S)]


def samples(files, out):
    """The images samples-METHOD-COUNT.png, and the errors that they state."""
    found = {}
    for name in files:
        if m := re.fullmatch(r'samples-(\w+)-(\d+)\.png', name):
            shutil.copy(files[name], os.path.join(out, 'figures', name))
            rmse = files.get(f'rmse-{m[1]}-{m[2]}.tex')
            found.setdefault(int(m[2]), {})[m[1]] = (
                open(rmse).read().strip(' %\n') if rmse else '')
    return sorted(found.items())


PLAYS = {'fig:efficiency': curves, 'fig:samples': samples}


def play(key, paths, out):
    """What web.js makes the playing figure of, or nothing."""
    if key not in PLAYS:
        return ''
    files = {name: os.path.join(path, name) for path in reversed(paths)
             if os.path.isdir(path) for name in os.listdir(path)}
    data = PLAYS[key](files, out)
    return (f'<div class="play" data-play="{PLAYS[key].__name__}" data-data="'
            + html.escape(json.dumps(data, ensure_ascii=False)) + '"></div>')
