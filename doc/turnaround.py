#!/usr/bin/env python3
"""What lies between a change and its effect, in seconds of processor time.

usage: turnaround.py NOWEB WEB... > doc/measured/turnaround.csv

Changes a sentence and puts it back. The least of three runs is given for what takes less
than a second. Needs an up-to-date build, and an idle machine.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import os
import resource
import subprocess
import sys


def cost(*command):
    """The processor time of a command and its children, seconds."""
    def used():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime
    before = used()
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode:
        sys.exit(f'{command[0]}: {done.stderr.decode()}')
    return used() - before


def least(*command):
    return min(cost(*command) for _ in range(3))


def after(path, old, new, *command):
    """The cost of a command after a change, which is then undone."""
    text, times = open(path, encoding='utf-8').read(), os.stat(path)
    if text.count(old) != 1:
        sys.exit(f'{path}: not once: {old}')
    try:
        with open(path, 'w', encoding='utf-8') as file:
            file.write(text.replace(old, new))
        return cost(*command)
    finally:
        with open(path, 'w', encoding='utf-8') as file:
            file.write(text)
        subprocess.run(command, capture_output=True, check=False)
        os.utime(path, (times.st_atime, times.st_mtime))


def main(noweb, *web):
    # The shell takes what is added to the backend's name, -delay, for its own.
    weave = '-index', '-delay', '-backend', 'sh -c cat', *web
    record = '--except', 'noweb/', '--record', 'src/.tangled'
    rows = [
        ('all chapters are tangled and no file is written',
         least(noweb, 'tangle', *record, *web)),
        ('all chapters are woven up to \\LaTeX',
         least(noweb, 'noweave', *weave)),
    ]
    if os.path.exists('/usr/bin/noweave'):
        rows += [('the same by the stages of \\noweb~2.12',
                  least('/usr/bin/noweave', *weave))]
    rows += [
        ('a sentence was changed: the book (\\ident{make pdf})',
         after('chapters/sky.nw', 'The sky does not', 'This sky does not', 'make', 'pdf')),
    ]
    print('after,seconds')
    for what, seconds in rows:
        print(f'{what},{seconds:.2f}' if seconds < 1 else
              f'{what},{seconds:.0f}')


main(*sys.argv[1:])
