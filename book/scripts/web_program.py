"""The files of a program and the chunks that their lines come from, for web.py.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import html
import os
import re
import subprocess
import tempfile


class Program:
    """What a web tangles to, by its record of tangled files."""

    def __init__(self, noweb, master, record):
        self.noweb = noweb
        self.names = [line.split()[1] for line in open(record)]
        told = ''.join(f'{name}:{i}\n' for name in self.names
                       for i in range(1, len(read(name).splitlines()) + 1))
        # The tool translates each line of each file to one of a chapter.
        places = subprocess.run([noweb, 'map', master, '--', 'cat'], input=told,
                                text=True, capture_output=True, check=True)
        self.origins = {name: [] for name in self.names}
        self.tangled, self.chunks = {}, {}
        for here, there in zip(told.splitlines(), places.stdout.splitlines()):
            name, line = here.rsplit(':', 1)
            self.origins[name].append(there)
            self.tangled.setdefault(there, []).append((name, int(line)))

    def add(self, label, place, first, last):
        """The files, and the line in each, to which a chunk's lines go."""
        where = {}
        for line in range(first, last + 1):
            self.chunks[f'{place}:{line}'] = label
            for name, at in self.tangled.get(f'{place}:{line}', ()):
                where[name] = min(at, where.get(name, at))
        return where

    def ranges(self, name):
        """The parts of a file, each from one chunk: first, last, label."""
        out = []
        for i, origin in enumerate(self.origins[name], 1):
            label = self.chunks.get(origin)
            if out and out[-1][2] == label:
                out[-1][1] = i
            else:
                out.append([i, i, label])
        return out

    def differs(self, pages):
        """The files that differ when tangled from the pages' text."""
        web = ''.join(map(copied, pages))
        with tempfile.TemporaryDirectory() as work:
            path = os.path.join(work, 'copied.nw')
            with open(path, 'w', encoding='utf-8') as out:
                out.write(web)
            subprocess.run([self.noweb, 'tangle', '-C', work, 'copied.nw'],
                           check=True)
            return [name for name in self.names
                    if read(name) != read(os.path.join(work, name))]


def read(name):
    if not os.path.exists(name):
        return ''
    return open(name, encoding='utf-8').read()


def text_of(s):
    """What a browser gives as textContent."""
    return html.unescape(re.sub(r'<[^>]*>', '', s))


def copied(page):
    """The chunks of a page as a web, from the text that a reader can copy."""
    out = []
    for name, code in re.findall(
            r'<b class="name">(.*?)</b>.*?<pre[^>]*><code>(.*?)</code></pre>',
            page, re.S):
        name = text_of(re.sub(r'</?code>', lambda m: '[[' if m[0][1] != '/'
                              else ']]', name))
        code = re.sub(r'<a class="chunk"[^>]*>⟨(.*?)⟩</a>', lambda m:
                      '\1' + re.sub('<code>', '[[', re.sub(
                          '</code>', ']]', m[1])) + '\2', code)
        code = re.sub(r'(<<|>>)', r'@\1', text_of(code))
        code = re.sub(r'^@(?=\s|@)', '@@', code, flags=re.M)
        code = code.replace('\1', '<<').replace('\2', '>>')
        out.append(f'<<{name}>>=\n{code}@\n\n')
    return ''.join(out)
