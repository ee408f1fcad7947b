#!/usr/bin/env python3
"""Sets the first screen of a report in HTML from its own parts.

usage: page.py REPORT.html FIGURES TABLES

Its drawing becomes commands of TikZ in TABLES/report-curve.tex, its two
pictures FIGURES/report-image.png and report-error.png, its head and first
table TABLES/report-head.tex and report-facts.tex, its captions
report-captions.tex.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import base64
import html
import os
import re
import sys


def attributes(tag):
    return dict(re.findall(r'([\w-]+)="([^"]*)"', tag))


def tex(text):
    """A text as LaTeX writes it."""
    text = html.unescape(re.sub(r'<[^>]+>', '', text))
    text = re.sub(r'([%&#_$])', r'\\\1', text)
    text = re.sub(r'(?<![\w.])-(?=[\d/])', r'$-$', text)
    return text.replace('±', r'$\pm$').replace('°', r'$^\circ$')


def point(x, y):
    return f'({float(x):.1f},{-float(y):.1f})'


def style(a):
    """The pen of an element."""
    words = [f'line width={0.6 * float(a.get("stroke-width", 1)):.1f}pt']
    if 'stroke-opacity' in a:
        words.append('black!30')
    if 'stroke-dasharray' in a:
        words.append('dashed')
    return ','.join(words)


def curve(svg):
    """The drawing in TikZ, y downwards."""
    out = []
    for tag in re.findall(r'<(?:rect|line|polyline|circle) [^>]*>', svg):
        a = attributes(tag)
        if tag.startswith('<rect'):
            corner = point(a['width'], a['height'])
            out.append(f'\\draw (0,0) rectangle {corner};')
        elif tag.startswith('<line'):
            ends = [point(a.get('x' + k, 0), a.get('y' + k, 0)) for k in '12']
            out.append(f'\\draw[{style(a)}] {ends[0]} -- {ends[1]};')
        elif tag.startswith('<circle'):
            out.append(f'\\fill {point(a["cx"], a["cy"])} circle (1.1pt);')
        elif a.get('points'):
            points = [point(*p.split(',')) for p in a['points'].split()]
            out.append(f'\\draw[{style(a)}] {" -- ".join(points)};')
    for tag, words in re.findall(r'(<text [^>]*>)(.*?)</text>', svg):
        a = attributes(tag)
        words = re.sub(r'<tspan[^>]*>(.*?)</tspan>', r'$^{\1}$', words)
        anchor = {'end': 'base east'}.get(a.get('text-anchor'), 'base')
        x, y, turn = a['x'], a['y'], ''
        if 'transform' in a:
            x, y, turn = a["y"], -float(a["x"]), ',rotate=90'
        out.append(f'\\node[anchor={anchor},inner sep=0{turn}] at '
                   f'{point(x, y)} {{{words}}};')
    return '\n'.join(out) + '\n'


def main(report, figures, tables):
    with open(report, encoding='utf-8') as file:
        page = file.read()

    def write(name, text):
        with open(os.path.join(tables, name), 'w', encoding='utf-8') as out:
            out.write(text)

    pictures = re.findall(r'data:image/png;base64,([^"]*)', page)
    for name, data in zip(('image', 'error'), pictures):
        path = os.path.join(figures, f'report-{name}.png')
        with open(path, 'wb') as out:
            out.write(base64.b64decode(data))
    svg = re.search(r'<svg.*</svg>', page, re.S).group()
    write('report-curve.tex', curve(svg))
    title = tex(re.search(r'<h1[^>]*>(.*?)</h1>', page, re.S).group(1))
    said = tex(re.search(r'</h1>.*?<p[^>]*>(.*?)</p>', page, re.S).group(1))
    write('report-head.tex', f'\\textbf{{{title}}}\\\\{said}\n')
    captions = re.findall(r'<figcaption>(.*?)</figcaption>', page, re.S)
    first, *others = map(tex, captions)
    write('report-captions.tex', ''.join(
        f'\\newcommand*{{\\reportcaption{k}}}{{{words}}}%\n'
        for k, words in zip('abc', [first] + others)))
    rows = re.findall(r'<tr[^>]*>\s*<t[hd][^>]*>(.*?)</t[hd]>\s*'
                      r'<td[^>]*>(.*?)</td>\s*</tr>', page, re.S)
    write('report-facts.tex', ''.join(
        f'{tex(k)} & {tex(v)} \\\\\n' for k, v in rows[:5]))


main(*sys.argv[1:])
