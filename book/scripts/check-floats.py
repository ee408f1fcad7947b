#!/usr/bin/env python3
"""Are figures, tables and algorithms mentioned, and made by the build?

usage: check-floats.py [--build DIRECTORY] CHAPTER.nw...

Each of them has one caption and a label, and the text refers to the label.
What a figure or a table reads is made by the build: a file in its directories
of figures, tables and examples, or an example that the build runs. With
--build, these files are looked for.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import os
import re
import sys

FLOAT = re.compile(r'\\begin{(figure|table|algorithm)}(.*?)\\end{\1}', re.S)
REFERENCE = re.compile(r'\\(?:ref|pageref|eqref|autoref|nameref){([^}]+)}')
READ = re.compile(r'\\(?:InputIfFileExists|IfFileExists|input|verbatiminput|'
                  r'includegraphics(?:\[[^]]*\])?){([^}#\\]+)}|'
                  r'\\addplot[^;]*?table\s*(?:\[[^]]*\])?\s*{([^}#\\\n]+)}')
PICTURES = ('', '.png', '.pdf')


def prose_of(text):
    """The text without its code, in the same lines."""
    lines, code = [], False
    for line in text.split('\n'):
        if re.match(r'<<.*>>=\s*$', line):
            code = True
        elif re.match(r'@(\s|$)', line):
            code = False
        lines.append('' if code else re.sub(r'(?<!\\)%.*', '', line))
    return '\n'.join(lines)


def check(path, text, referred, folders):
    """How many floats a chapter has, and what is wrong with them."""
    faults = []

    def fault(at, what):
        line = text.count('\n', 0, at) + 1
        faults.append(f'{path}:{line}: {what}')

    floats = list(FLOAT.finditer(text))
    for match in floats:
        kind, body = match.groups()
        labels = re.findall(r'\\label{((?:fig|tab|alg):[^}]+)}', body)
        if body.count('\\caption') == 0:
            fault(match.start(), f'this {kind} has no caption')
        if not labels:
            fault(match.start(), f'this {kind} has no label')
        for label in labels:
            if label not in referred:
                fault(match.start(), f'nothing refers to the {kind} {label}')
    for match in READ.finditer(text):
        name = match.group(1) or match.group(2)
        places = [os.path.join(folder, name + end)
                  for folder in folders for end in PICTURES]
        if folders and not any(map(os.path.exists, places)):
            fault(match.start(), f'{name} is not made by the build')
    return len(floats), faults


def main(paths):
    folders = []
    if paths[:1] == ['--build']:
        folders = [os.path.join(paths[1], part)
                   for part in ('', 'figures', 'tables', 'examples')]
        folders += ['doc/examples', 'doc/figures']
        del paths[:2]
    if not paths:
        sys.exit(__doc__)
    texts = {}
    for path in paths:
        with open(path, encoding='utf-8') as file:
            texts[path] = prose_of(file.read())
    referred = {label for text in texts.values()
                for label in REFERENCE.findall(text)}
    count, faults = 0, []
    for path, text in texts.items():
        found, wrong = check(path, text, referred, folders)
        count, faults = count + found, faults + wrong
    for fault in faults:
        print(f'error: {fault}')
    print(f'{count} figures, tables and algorithms, {len(faults)} faults')
    sys.exit(1 if faults else 0)


if __name__ == '__main__':
    main(sys.argv[1:])
