#!/usr/bin/env python3
"""What opening a large chapter costs vim, with and without noweb/vim.

usage: bench/vim.py CHAPTER.nw OTHER.nw

Prints a table as CSV: milliseconds of processor time, the least of ten runs, in
a terminal of 50 lines, to open CHAPTER, to go to its end as well, and to open
OTHER as well; without file types, with both taken for LaTeX, and with noweb/vim.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import fcntl
import os
import pathlib
import pty
import struct
import sys
import termios

OURS = pathlib.Path(__file__).resolve().parent.parent / 'noweb/vim'
TYPES = ['--cmd', 'syntax on', '--cmd', 'filetype plugin on']
SETTINGS = {
    'plain text': [],
    r'\LaTeX{} alone': ['--cmd', 'autocmd BufRead *.nw set filetype=tex', *TYPES],
    r'\file{noweb/vim}': ['--cmd', f'set runtimepath^={OURS}', *TYPES],
}


def milliseconds(arguments):
    """Processor time of vim in a terminal of its own."""
    child, terminal = pty.fork()
    if child == 0:
        fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack('4H', 50, 100, 0, 0))
        os.environ['TERM'] = 'xterm'
        os.execvp('vim', ['vim', '-Nu', 'NONE', '-i', 'NONE', '-n', *arguments])
    try:
        while os.read(terminal, 65536):
            pass
    except OSError:
        pass
    _, status, usage = os.wait4(child, 0)
    os.close(terminal)
    if status:
        sys.exit(f'error: vim ended with {status}')
    return 1000 * (usage.ru_utime + usage.ru_stime)


def least(settings, paths, commands):
    ends = [part for command in [*commands, 'redraw', 'quitall!']
            for part in ('-c', command)]
    return min(milliseconds([*settings, *paths, *ends]) for _ in range(10))


def main(chapter, other):
    print('what,open,end,other')
    for name, settings in SETTINGS.items():
        opened = least(settings, [chapter], [])
        end = least(settings, [chapter], ['redraw', 'normal! G'])
        second = least(settings, [chapter], ['redraw', f'edit {other}'])
        more = [max(0, time - opened) for time in (end, second)]
        print(f'{name},{opened:.0f},{more[0]:.0f},{more[1]:.0f}')


if __name__ == '__main__':
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
