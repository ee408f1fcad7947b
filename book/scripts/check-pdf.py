#!/usr/bin/env python3
"""Does the book print the code that is compiled?

usage: check-pdf.py VOLUME.pdf... CHAPTER.nw...

Extracts the text of the volumes with pdftotext and looks for every line of
every chunk of the chapters, in order, below the head of its chunk; white space is
left out of the comparison, and so are the head and the foot of a page. Fails
when a line is missing or differs.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import re
import subprocess
import sys
from multiprocessing.pool import ThreadPool

LABEL = r'\s\d+(?:[a-z]|\.\d+)'
USE = re.compile(rf'⟨((?:(?!⟩).)*){LABEL}⟩')
HEAD = re.compile(rf'\s*\d+(?:[a-z]|\.\d+)\s*{USE.pattern}\s*\+?≡')
SAME = {'’': "'", '‘': '`', '“': '``', '”': "''", '–': '--', '—': '---'}


def squeeze(text):
    return re.sub(r'\s', '', text)


def plain(name):
    """A chunk's name as both sides can be compared: no spaces, no typography."""
    for curly, straight in SAME.items():
        name = name.replace(curly, straight)
    return squeeze(re.sub(r'\[\[(.*?\]*)\]\]', r'\1', name))


def chunks_of(path):
    """(name, line number, code lines) of every chunk of a chapter."""
    name, lines, start, found = None, [], 0, []
    for number, line in enumerate(open(path, encoding='utf-8'), 1):
        line = line.rstrip('\r\n')
        head = re.match(r'<<(.+?)>>=\s*$', line)
        if head or re.match(r'@(\s|$)', line):
            if name is not None:
                found.append((name, start, lines))
            name, lines, start = (head and head.group(1)), [], number
        elif name is not None:
            lines.append(line[1:] if line.startswith('@@') else line)
    if name is not None:
        found.append((name, start, lines))
    return found


def expected(line):
    """What the book prints for a line of code, without labels and spaces."""
    use = re.compile(r'(?<!@)<<((?:\[\[.*?\]\]|[^@]|@(?!>>))*?)>>')
    line = use.sub(lambda m: f'⟨{plain(m.group(1))}⟩', line)
    return squeeze(line.replace('@<<', '<<').replace('@>>', '>>'))


def without_labels(row):
    return squeeze(USE.sub(lambda m: f'⟨{plain(m.group(1))}⟩', row))


def book_lines(volumes):
    """The lines of the book without heads and feet; where pages begin."""
    def extract(pdf):
        return subprocess.run(['pdftotext', '-layout', pdf, '-'], check=True,
                              stdout=subprocess.PIPE).stdout.decode()

    with ThreadPool() as pool:
        text = ''.join(pool.map(extract, volumes))
    lines, starts = [], set()
    for page in text.split('\f'):
        rows = [row for row in page.split('\n') if row.strip()]
        if rows and re.search(r'\S\s{3,}(\d+|[ivx]+)$', rows[0]):
            del rows[0]
        elif rows and re.fullmatch(r'\s*\d+', rows[-1]):
            del rows[-1]
        starts.add(len(lines))
        lines += rows
    return lines, starts


def head_at(lines, at):
    """The name in the head of a chunk and where its code begins, or None."""
    if '⟨' in lines[at]:
        for end in range(at + 1, min(at + 5, len(lines) + 1)):
            if match := HEAD.match(' '.join(lines[at:end])):
                return plain(match.group(1)), end
    return None


def row_at(lines, at):
    """A row of code, joined with the next ones if a name is broken there."""
    row, end = lines[at], at + 1
    while row.count('⟨') > row.count('⟩') and end < len(lines):
        row, end = row + ' ' + lines[end], end + 1
    return row, end


def find_row(lines, starts, at, want):
    """The row that prints a line of code and what follows it, or None.

    It is the next row; but a figure may stand where a page ends and the next
    one begins.
    """
    for skipped in range(at, min(at + 60, len(lines))):
        row, end = row_at(lines, skipped)
        if without_labels(row) == want and (
                skipped == at or starts & set(range(at, skipped + 1))):
            return row, end
    return None


def compare(lines, starts, chapters):
    """Follows the chapters through the book; names, a count, and faults."""
    heads = [head for at in range(len(lines)) if (head := head_at(lines, at))]
    names, faults, count, next_head = set(), [], 0, 0
    for path in chapters:
        for name, start, body in chunks_of(path):
            want = plain(name)
            found = next((i for i in range(next_head, len(heads))
                          if heads[i][0] == want), None)
            if found is None:
                faults.append(f'{path}:{start}: chunk not in the book: {name}')
                continue
            next_head, at = found + 1, heads[found][1]
            for offset, line in enumerate(body, 1):
                if not line.strip():
                    continue
                count += 1
                row = find_row(lines, starts, at, expected(line))
                if row is None:
                    faults.append(f'{path}:{start + offset}: not as printed: '
                                  f'{line.strip()}\n    the book has: '
                                  f'{"".join(lines[at:at + 1])}')
                    break
                at = row[1]
                names.add(want)
    return names, count, faults


def main(arguments):
    if len(arguments) < 2:
        sys.exit(__doc__)
    volumes = [name for name in arguments if name.endswith('.pdf')]
    names, count, faults = compare(*book_lines(volumes), arguments[len(volumes):])
    print(f'{count} lines of code of {len(names)} chunks in the book as in the '
          f'chapters, {len(faults)} chunks differ')
    for fault in faults[:20]:
        print(fault)
    sys.exit(1 if faults else 0)


if __name__ == '__main__':
    main(sys.argv[1:])
