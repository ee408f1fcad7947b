#!/usr/bin/env python3
"""Sizes of the chunks of chapters, and how much prose stands beside them.

usage: chunk-statistics.py CHAPTER.nw...

Counts non-blank lines of code per chunk, and words of prose without the
commands and the mathematics of TeX. Fails when a chunk is longer than a page
of the book can show well (40 lines).

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import re
import statistics
import sys

LONGEST = 40


def read(path):
    """(place, name, lines of code) of the chunks, and the words of prose."""
    chunks, words, code = [], 0, None
    for number, line in enumerate(open(path, encoding='utf-8'), 1):
        if head := re.match(r'<<(.+?)>>=\s*$', line):
            code = [f'{path}:{number}', head.group(1), 0]
            chunks.append(code)
        elif re.match(r'@(\s|$)', line):
            code = None
        elif code:
            code[2] += bool(line.strip())
        elif not line.startswith('%'):
            prose = re.sub(r'\$[^$]*\$|\\[A-Za-z]+', ' ', line)
            words += len(re.findall(r"[A-Za-z][\w'-]+", prose))
    return chunks, words


def main(paths):
    if not paths:
        sys.exit(__doc__)
    chunks, words = [], 0
    for path in paths:
        more, count = read(path)
        chunks += more
        words += count
    sizes = sorted(size for _, _, size in chunks)
    print(f'{len(sizes)} chunks, {sum(sizes)} lines of code; median '
          f'{statistics.median(sizes):g}, 85 % within '
          f'{sizes[int(0.85 * (len(sizes) - 1))]}, longest {sizes[-1]}; '
          f'{words / max(sum(sizes), 1):.1f} words of prose per line')
    long = [chunk for chunk in chunks if chunk[2] > LONGEST]
    for place, name, size in long:
        print(f'{place}: {size} lines: {name}')
    sys.exit(1 if long else 0)


if __name__ == '__main__':
    main(sys.argv[1:])
