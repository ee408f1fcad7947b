#!/usr/bin/env python3
"""Makes a web site of a woven book: a page for each chapter.

usage: web.py NOWEB DIR/MASTER.nw RECORD TEX_DIR OUT

It reads TEX_DIR/MASTER.tex, the woven chapters beside it, and what LaTeX has
left in their .aux files (numbers of sections, floats and chunks), so that the
site has the numbers of the PDF; OUT has web.css already, and the scripts. Prose
goes through pandoc, formulas become MathML, chunks are set by this program, and
the figures that LaTeX draws are compiled to SVG by one more run of pdflatex.
NOWEB, the tool, says where each line of the files of RECORD comes from
(web_program.py); what a reader looks things up by is in web_reader.py, and what
a reader plays with in web_play.py. TEXINPUTS must be that of the book. Links
that lead nowhere, formulas that pandoc cannot read, numbers that are missing and
files that differ when tangled from what a page shows are faults.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import html
import math
import os
import re
import shutil
import subprocess
import sys

import web_play
import web_program
import web_reader

NOWEB, WEB, RECORD, TEX, OUT = sys.argv[1:6]
MASTER = os.path.basename(WEB).removesuffix('.nw')
PATHS = [p for p in os.environ.get('TEXINPUTS', '').split(':') if p]
NAMES = {'litpt': 'litpt', 'pt': 'pt', 'noweb': 'noweb',
         'notangle': 'notangle', 'noweave': 'noweave'}
warnings = []


def find(name):
    """The text of a file that LaTeX would input, or None."""
    for path in [TEX, *PATHS]:
        file = os.path.join(path, name)
        if os.path.isfile(file):
            return open(file, encoding='utf-8').read()
    return None


def group(s, i, brackets='{}'):
    """The group that begins at s[i], and the place after it."""
    assert s[i] == brackets[0], s[max(0, i - 60):i + 60]
    depth, j = 0, i
    while True:
        if s[j] == '\\':
            j += 1
        elif s[j] == brackets[0]:
            depth += 1
        elif s[j] == brackets[1]:
            depth -= 1
            if not depth:
                return s[i + 1:j], j + 1
        j += 1


def expand(s, name, arguments, function, option=False):
    """Replaces the macro in s by what the function makes of its arguments."""
    out, at = [], 0
    pattern = re.compile(r'\\' + name + r'(?![a-zA-Z@])[ ]?')
    while m := pattern.search(s, at):
        i, args = m.end(), []
        if option:
            value = None
            if s[i:i + 1] == '[':
                value, i = group(s, i, '[]')
            args.append(value)
        try:
            for _ in range(arguments):
                while s[i].isspace():
                    i += 1
                value, i = group(s, i)
                args.append(value)
        except (AssertionError, IndexError):
            out.append(s[at:m.end()])
            at = m.end()
            continue
        out.append(s[at:m.start()] + function(*args))
        at = i
    return ''.join(out) + s[at:]


# ---- what LaTeX knows: numbers of labels, chunks and sources

numbers, page_of, labels, cited, measured = {}, {}, {}, {}, {}
identifiers, places, defined_in = {}, {}, {}


def read_aux(name):
    page = 'index' if name == MASTER else name
    subpages = {}
    for line in open(os.path.join(TEX, name + '.aux'), encoding='utf-8'):
        if m := re.match(r'\\newlabel\{([^}]*)\}\{\{(.*)', line):
            t = re.match(r'\\M@TitleReference \{([^}]*)\}', m[2])
            numbers[m[1]] = t[1] if t else m[2].split('}')[0]
            page_of[m[1]] = page
        elif m := re.match(r'\\newsublabel\{([^}]*)\}\{([^}]*)\}', line):
            letter = subpages.get(m[2], 0)
            subpages[m[2]] = letter + 1
            labels[m[1]] = (m[2], letter)
            page_of[m[1]] = page
        elif m := re.match(
                r'\\nwixadd\{\\nwix([du]) ?\}\{([^}]*)\}\{([^}]*)\}', line):
            places.setdefault(m[2], []).append((m[1] != 'd', m[3]))
            if m[1] == 'd':
                defined_in[m[2]] = m[3]
        elif m := re.match(
                r'\\nwixadds\{i\}\{\{\\nwixident ?\{(.*)\}\}\{([^}]*)\}\}',
                line):
            identifiers[m[2]] = plain(m[1])
        elif m := re.match(r'\\bibcite\{([^}]*)\}\{([^}]*)\}', line):
            cited[m[1]] = m[2]


def chunk_label(label):
    """The page of the PDF and a letter, as the PDF has it."""
    if label not in labels:
        return '?'
    number, letter = labels[label]
    return number + 'abcdefghijklmnopqrstuvwxyz'[letter]


def read_measured():
    for name in ['measured.tex', 'said.tex', 'learnt.tex',
                 'geometry.tex', 'chance.tex', 'bounces.tex']:
        for m in re.finditer(
                r'\\nwmeasured\{(.*?)\}\{(.*?)\}\{(.*?)\}\{(.*?)\}%',
                find(name) or ''):
            measured[m.groups()[:3]] = m[4]


def fixed(value, places):
    places = int(places)
    text = f'{abs(round(value, places)):.{max(places, 0)}f}'
    whole, _, rest = text.partition('.')
    if len(whole) > 4:
        whole = re.sub(r'(?<=\d)(?=(\d{3})+$)', r'\\,', whole)
    return ('$-$' if value < 0 else '') + whole + (rest and '.' + rest)


def tell(places, *key):
    key = tuple(' '.join(part.split()) for part in key)
    value = measured.get(key)
    if value is None:
        warnings.append('nothing measured: ' + '/'.join(key))
        return '??'
    return value if places is None else fixed(float(value), places)


def compute(places, formula):
    formula = expand(formula, 'valueof', 3,
                     lambda *key: f'({measured.get(key, "nan")})')
    formula = formula.replace('^', '**').replace('\\,', '')
    try:
        return fixed(eval(formula, {'__builtins__': {}}, {
            'sqrt': math.sqrt, 'ln': math.log, 'exp': math.exp, 'abs': abs,
            'max': max, 'min': min, 'round': round, 'pi': math.pi}),
            places or 0)
    except Exception as error:
        warnings.append(f'not computed: {formula}: {error}')
        return '??'


# ---- chunks

def link(label):
    if label not in page_of:
        warnings.append('no place ' + label)
    return f'{page_of.get(label)}.html#{label}'


def anchor(label):
    text = chunk_label(label)
    return f'<a href="{link(label)}">{text}</a>'


SPECIAL = {'nwbackslash': '\\', 'nwlbrace': '{', 'nwrbrace': '}', 'litpt':
           'litpt', 'pt': 'pt', 'noweb': 'noweb', 'nwendquote': '', 'Tt': '',
           'edoc': '', 'code': '', 'textbackslash': '\\', 'relax': ''}


def plain(s):
    """The text of a chunk's name or of an identifier."""
    s = re.sub(r'\\(Tt|nwendquote|code|edoc)(\{\})?\s?', '', s)
    s = s.replace(r'\nwixident', '')
    s = re.sub(r'\\(nwbackslash|nwlbrace|nwrbrace)(\{\})?',
               lambda m: SPECIAL[m[1]], s)
    s = re.sub(r'\\([{}_#$%&\\ ])', r'\1', s)
    return html.escape(re.sub(r'(?<!\\)[{}]', '', s).replace('~', ' ').strip())


def chunk_name(s):
    """A chunk's name, whose code is code."""
    s = re.sub(r'\\code(\{\})?\s?', '\1', re.sub(r'\\edoc(\{\})?', '\2', s))
    return plain(s).replace('\1', '<code>').replace('\2', '</code>')


program = web_program.Program(NOWEB, WEB, RECORD)


def code_html(s):
    out, i = [], 0
    while i < len(s):
        c = s[i]
        if c == '\\':
            m = re.compile(r'\\([a-zA-Z]+)(\{\})?|\\(.)', re.S).match(s, i)
            name, i = m[1], m.end()
            if m[3] is not None:
                out.append(html.escape(m[3]))
            elif name in ('nwkeyword', 'nwcomment'):
                body, i = group(s, i)
                tag = 'b' if name == 'nwkeyword' else 'i'
                out.append(f'<{tag}>{code_html(body)}</{tag}>')
            elif name in ('nwindexdefn', 'nwindexuse'):
                _, i = group(s, i)
                _, i = group(s, i)
                _, i = group(s, i)
            elif name in ('nwlinkedidentc', 'nwlinkedidentq'):
                body, i = group(s, i)
                label, i = group(s, i)
                out.append(f'<a class="id" href="{link(label)}">'
                           f'{code_html(body)}</a>')
            elif name == 'LA':
                end = s.index(r'\RA', i)
                inner = s[i:end]
                i = end + len(r'\RA')
                if s.startswith('{}', i):
                    i += 2
                k = inner.rfind('~{\\nwtagstyle')
                label = re.search(r'subpageref\{([^}]*)\}', inner[k:])
                out.append(f'<a class="chunk" href="{link(label[1])}">⟨'
                           f'{chunk_name(inner[:k])}⟩</a>' if k >= 0 and label
                           else '⟨' + plain(inner) + '⟩')
            elif name in SPECIAL:
                out.append(html.escape(SPECIAL[name]))
            elif name == 'eatline':
                pass
            else:
                warnings.append('in code: \\' + name)
        elif c in '{}':
            i += 1
        else:
            out.append(html.escape(c))
            i += 1
    return ''.join(out)


def items(s):
    return re.findall(r'\\\\\{([^{}]*)\}', s)


CHUNK = re.compile(
    r'(?:\\nwfilename\{[^}]*\})?\\nwbegincode\{\d+\}\\sublabel\{([^}]*)\}'
    r'\\nwmargintag\{.*?\}\}\}\\moddef\{(.*?)~\{\\nwtagstyle\{\}\\subpageref'
    r'\{([^}]*)\}\}\}\\(plus)?endmoddef\\nwstartdeflinemarkup'
    r'(.*?)\\nwenddeflinemarkup\n(.*?)'
    r'\\nwendcode\{\}(?:\\nwbegindocs\{\d+\}\\nwdocspar)?', re.S)
FOOTER = re.compile(r'^\\(nwused|nwnotused|nwoutput|nwalsodefined|'
                    r'nwidentdefs|nwidentuses)\{', re.M)


def chunk_html(m, place):
    label, name, first, plus, markup, body = m.groups()
    footer = ''
    if f := FOOTER.search(body):
        body, footer = body[:f.start()], body[f.start():]
    body = body.replace('\\eatline\n', '')
    line = m.string.count('\n', 0, m.start(1)) + 1
    files = list(program.add(label, place, line + 1,
                             line + body.count('\n')).items())
    where = ', '.join(f'<a href="files.html#{file}">{file}:{at}</a>'
                      for file, at in files[:2])
    if len(files) > 2:
        where += f' and {len(files) - 2} more'
    said = []
    for key, word in [('nwalsodefined', 'Continued in'), ('nwused', 'Used in')]:
        if f := re.search(r'\\' + key + r'\{((?:\\\\\{[^{}]*\})*)\}', footer):
            said.append(f'{word} ' + ', '.join(map(anchor, items(f[1]))) + '.')
    for key, word in [('nwidentdefs', 'Defines'), ('nwidentuses', 'Uses')]:
        at = footer.find('\\' + key + '{')
        names = at >= 0 and re.findall(
            r'\\\\\{\{(\\nwixident.*?)\}\{([^{}]*)\}\}',
            group(footer, footer.index('{', at))[0])
        if names:
            said.append(word + ' ' + ', '.join(
                f'<a class="id" href="{link(defined_in[k])}"><code>{plain(n)}'
                '</code></a>' if k in defined_in and key == 'nwidentuses'
                else f'<code>{plain(n)}</code>' for n, k in names) + '.')
    if 'nwnotused' in footer:
        said.append('Root chunk.')
    back = ''
    if f := re.search(r'\\nwprevnextdefs\{([^}]*)\}\{([^}]*)\}', markup):
        back = ' '.join(mark % anchor(x) for mark, x in
                        [('◁ %s', f[1]), ('%s ▷', f[2])] if x in labels)
    return (f'<section class="code" id="{label}"><header>'
            f'<a class="tag" href="#{label}">{chunk_label(label)}</a> '
            f'<span>⟨<b class="name">{chunk_name(name)}</b> {anchor(first)}⟩'
            f'{"+" if plus else ""}≡</span><span class="nav">{back}</span>'
            f'<span class="place">{place}:{line} → {where}</span></header>\n'
            f'<pre tabindex="0"><code>{code_html(body)}</code></pre>'
            f'<footer>{" ".join(said)}</footer></section>')


# ---- prose

def mono(s):
    s = re.sub(r'\\([{}_#$%&~ ])', r'\1', s).replace('\\textasciitilde', '~')
    s = re.sub(r'\\-', '', s)
    for a, b in [('\\', '\0'), ('{', r'\{'), ('}', r'\}'), ('_', r'\_'),
                 ('#', r'\#'), ('$', r'\$'), ('%', r'\%'), ('&', r'\&'),
                 ('~', r'\textasciitilde{}'), ('^', r'\textasciicircum{}'),
                 ('\0', r'\textbackslash{}')]:
        s = s.replace(a, b)
    return r'\texttt{' + s.replace('--', '-{}-') + '}'


def refer(key):
    if key not in numbers:
        warnings.append('no label ' + key)
        return '??'
    return rf'\href{{{page_of[key]}.html\#{key}}}{{{numbers[key]}}}'


def exercise(grade, key):
    page = page_of.get('answer:' + key)
    answer = rf'(\href{{{page}.html\#answer:{key}}}{{answer}}) '
    return (f'\n\n\\hypertarget{{exercise:{key}}}{{}}'
            rf'\textbf{{{numbers.get("exercise:" + key, "?")}}} '
            + (' □▣■'[int(grade or 0)] + ' ').lstrip() + (answer if page else ''))


def cite(note, keys):
    links = ', '.join(rf'\href{{bibliography.html\#{k.strip()}}}'
                      rf'{{{cited.get(k.strip(), "?")}}}'
                      for k in keys.split(','))
    return '[' + links + (', ' + note if note else '') + ']'


class Chapter:
    def __init__(self, name, number, drawings):
        self.name, self.number, self.drawings = name, number, drawings
        self.place = os.path.join(os.path.dirname(WEB), f'chapters/{name}.nw')
        self.kept, self.subjects = [], []
        self.count = self.headed = 0

    def keep(self, text):
        self.kept.append(text)
        return f'\n\nLITPTKEPT{len(self.kept) - 1}X\n\n'

    def read(self):
        s = find(self.name + '.tex')
        s = re.sub(r'\A(.*) % Made by noweave.*', r'\1', s)
        s = CHUNK.sub(lambda m: self.keep(chunk_html(m, self.place)), s)
        s = re.sub(r'\\nwminiindex\{(?:.|\n)*?\n?(?=\\nwenddocs|\Z|\n)', '', s)
        s = re.sub(r'\\nwixlogsorted.*|\\nwfilename\{.*?\}|\\nwbegindocs\{\d+\}'
                   r'|\\nwdocspar|\\nwenddocs\{\}', '', s)
        s = expand(s, 'verbatiminput', 1, lambda f: self.keep(
            '<pre tabindex="0">' + html.escape(find(f) or '?') + '</pre>'))
        s = re.sub(r'\\begin\{verbatim\}\n?(.*?)\\end\{verbatim\}', lambda m:
                   self.keep(f'<pre tabindex="0">{html.escape(m[1])}</pre>'),
                   s, flags=re.S)
        s = re.sub(r'\\verb(.)(.*?)\1', lambda m: mono(m[2]), s)
        s = re.sub(r'(?<!\\)%.*\n[ ]*', '', s)
        s = re.sub(r'\{\\Tt\{\}(.*?)\\nwendquote\}',
                   lambda m: mono(plain_code(m[1])), s, flags=re.S)
        for macro in ('opt', 'file', 'ident'):
            s = expand(s, macro, 1, mono)
        s = expand(s, 'index', 1, self.subject)
        s = self.floats(s)
        s = self.words(s)
        return s

    def subject(self, entry):
        self.subjects.append(entry)
        return '' if '|' in entry else (
            rf'\hypertarget{{subject-{len(self.subjects)}}}{{}}')

    def html(self):
        body = pandoc(expand(self.read(), 'chapter', 1, lambda _: ''))
        body = re.sub(r'(?:<p>)?\s*LITPTKEPT(\d+)X\s*(?:</p>)?',
                      lambda m: self.kept[int(m[1])], body)
        self.body = re.sub(r'<figure class="figure" id="(.*?)".*?</figure>',
                           self.figure, body, flags=re.S)
        return self.body

    def figure(self, m):
        alt = web_reader.alternative(m[0])
        return re.sub(r'<(?:img|embed) src="([^"]*)"[^>]*>', lambda img:
                      f'<img src="{img[1]}" alt="{alt}">', m[0]
                      ) + web_play.play(m[1], PATHS, OUT)

    def words(self, s):
        s = expand(s, 'InputIfFileExists', 3,
                   lambda f, _, alt: inputs(f) or alt)
        s = expand(s, 'IfFileExists', 3, lambda f, yes, no: yes)
        s = expand(s, 'input', 1, lambda f: inputs(f) or '')
        for name, value in re.findall(
                r'\\newcommand\*\{\\(\w+)\}\{(.*)\}', find('numbers.tex') or ''):
            s = re.sub(r'\\' + name + r'(?![a-zA-Z])(\{\})?',
                       lambda _: value, s)
        s = expand(s, 'measured', 3, tell, option=True)
        s = expand(s, 'computed', 1, compute, option=True)
        for name, text in NAMES.items():
            s = re.sub(r'\\' + name + r'(?![a-zA-Z])(\{\}|\\(?= ))?',
                       r'\\textsf{' + text + '}', s)
        s = s.replace(r'\toolbook', r'\href{noweb/index.html}'
                      '{noweb: a small tool for literate programs}')
        s = re.sub(r'\\begin\{(equation|align)\}(.*?)\\end\{\1\}',
                   self.equation, s, flags=re.S)
        s = self.headings(s)
        s = expand(s, 'label', 1, lambda k: rf'\hypertarget{{{k}}}{{}}')
        s = expand(s, 'eqref', 1, lambda k: '(' + refer(k) + ')')
        s = expand(s, 'pageref', 1, lambda k: refer(k))
        s = expand(s, 'ref', 1, refer)
        s = expand(s, 'cite', 1, cite, option=True)
        s = re.sub(r'\\begin\{goals\}', lambda _: self.keep(
            '<aside class="goals"><p>After this chapter you can</p>')
            + r'\begin{itemize}', s)
        s = s.replace(r'\end{goals}', r'\end{itemize}' + self.keep('</aside>'))
        s = s.replace(r'\begin{exercises}', r'\section*{Exercises}')
        s = s.replace(r'\end{exercises}', '')
        s = expand(s, 'paragraph', 1, lambda t: rf'\textbf{{{t}}} ')
        s = expand(s, 'exercise', 1, exercise, option=True)
        s = expand(s, 'answer', 1, lambda k: '\n\n\\section*{'
                   rf'\hypertarget{{answer:{k}}}{{}}Answer to exercise '
                   + refer('exercise:' + k) + '}\n\n')
        s = re.sub(r'\\(cmidrule(\([a-z]*\))?\{[^}]*\}|centering|small|smallskip'
                   r'|footnotesize|scriptsize|raggedright|noindent|strut|hfill'
                   r'|medskip|bigskip|tiny|clearpage|addlinespace)(?![a-zA-Z])',
                   '', s)
        s = re.sub(r'\\(setlength|vspace)\*?(\{[^}]*\}|\\\w+)(\{[^}]*\})?', '', s)
        s = re.sub(r'(\\begin\{tabular\})\{((?:[^{}]|\{[^{}]*\})*)\}',
                   lambda m: m[1] + '{' + columns(m[2]) + '}', s)
        return s

    def equation(self, m):
        body = re.sub(r'\\notag', '', m[2])
        keys = re.findall(r'\\label\{([^}]*)\}', body)
        body = re.sub(r'\\label\{[^}]*\}', '', body)
        if m[1] == 'align':
            body = r'\begin{aligned}' + body + r'\end{aligned}'
        tags = ', '.join(f'({numbers.get(key, "?")})' for key in keys)
        at = ''.join(rf'\hypertarget{{{key}}}{{}}' for key in keys)
        return f'{at}\\[{body.strip()}' + (
            rf'\qquad\text{{{tags}}}' if tags else '') + '\\]'

    def headings(self, s):
        out, at = [], 0
        for m in re.finditer(r'\\((?:sub)*section)(\*?)(?=\{)', s):
            title, end = group(s, m.end())
            number = ''
            if m[1] == 'section' and not m[2]:
                self.count += 1
                number = f'{self.number}.{self.count}'
            self.headed += 1
            key = f'section-{self.headed}'
            out.append(s[at:m.start()] + rf'\{m[1]}*{{\hypertarget{{{key}}}{{}}'
                       + (number + ' ' if number else '') + title + '}')
            at = end
        return ''.join(out) + s[at:]

    def floats(self, s):
        def one(m):
            kind, body = m[1], m[2]
            key = re.search(r'\\label\{((?:fig|tab|alg)[^}]*)\}', body)
            key = key[1] if key else ''
            caption = ''

            def take(_, text):
                nonlocal caption
                caption = text
                return ''
            body = expand(body, 'caption', 1, take, option=True)
            if kind != 'algorithm':
                body = re.sub(r'\\label\{[^}]*\}', '', body)
            body = body.replace(rf'\label{{{key}}}', '')
            body = re.sub(r'^\[[^\]]*\]', '', body)
            if kind == 'figure':
                body = rf'\includegraphics{{{self.draw(body, key)}}}'
            if kind == 'algorithm':
                body = algorithm(body)
            word = f'{kind.capitalize()} {numbers.get(key, "?")}. '
            return (self.keep(f'<figure class="{kind}" id="{key}">') + body
                    + self.keep('<figcaption>')
                    + f'\n\n\\textbf{{{word}}}{caption}\n\n'
                    + self.keep('</figcaption></figure>'))
        return re.sub(r'\\begin\{(figure|table|algorithm)\}(.*?)\\end\{\1\}',
                      one, s, flags=re.S)

    def draw(self, body, key):
        file = 'figures/' + (key or f'{self.name}-{len(self.drawings)}'
                             ).replace(':', '-') + '.svg'
        self.drawings.append((file, body))
        return file


def plain_code(s):
    s = re.sub(r'\\LA\{\}(.*?)~\{\\nwtagstyle\{\}\\subpageref\{[^}]*\}\}'
               r'\\RA\{\}', r'⟨\1⟩', s)
    return re.sub(r'\\nwlinkedident[cq]\{((?:[^{}]|\\[{}])*)\}\{[^}]*\}', r'\1',
                  re.sub(r'\\nwindexuse\{.*?\}\{.*?\}\{.*?\}', '', s)).replace(
        r'\nwbackslash{}', '\\').replace(r'\protect', '')


def inputs(name):
    s = find(name if '.' in name.split('/')[-1] else name + '.tex')
    return s and re.sub(r'(?<!\\)%.*\n?', '', s)


def columns(s):
    s = re.sub(r'[@>!<]\{(?:[^{}]|\{[^{}]*\})*\}', '', s)
    s = re.sub(r'[pm]\{[^{}]*\}', 'l', s)
    s = re.sub(r'\*\{(\d+)\}\{(\w)\}', lambda m: m[2] * int(m[1]), s)
    return re.sub(r'[^lcr]', '', s)


def algorithm(s):
    s = expand(s, 'given', 1, lambda t: rf'\textbf{{Given:}} {t}' + '\n\n')
    s = expand(s, 'gives', 1, lambda t: rf'\textbf{{Gives:}} {t}' + '\n\n')
    s = expand(s, 'note', 1, lambda t: rf' \emph{{({t})}}')
    for macro, word in [('If', 'if'), ('For', 'for'), ('While', 'while')]:
        s = expand(s, macro, 1, lambda t: rf'\item \textbf{{{word}}} {t} '
                   r'\begin{itemize}' + '\n')
    s = expand(s, 'ElseIf', 1, lambda t: r'\end{itemize}\item \textbf{else if} '
               + t + r' \begin{itemize}' + '\n')
    for macro, text in [
            ('Loop', r'\item \textbf{repeat} \begin{itemize}' + '\n'),
            ('Else', r'\end{itemize}\item \textbf{else} \begin{itemize}' + '\n'),
            ('End', r'\end{itemize}' + '\n'), ('Step', r'\item '),
            ('Where', ''), ('Return', r'\item \textbf{return} ')]:
        s = re.sub(r'\\' + macro + r'(?![a-zA-Z])', lambda _: text, s)
    return s.replace(r'\begin{steps}', r'\begin{itemize}').replace(
        r'\end{steps}', r'\end{itemize}')


def draw_all(drawings):
    """All figures in one run of LaTeX, each on a page of its size."""
    work = os.path.join(TEX, 'web')
    os.makedirs(work, exist_ok=True)
    source = find(MASTER + '.tex').split(r'\begin{document}')[0]
    source += '\\begin{document}\\input{web-labels}\n'
    for _, body in drawings:
        source += ('\\setbox0\\vbox{\\hsize=\\textwidth\\centering '
                   '\\begin{minipage}{\\textwidth}' + body
                   + '\\end{minipage}}\\setbox0\\vbox{\\kern4bp\\hbox{\\kern4bp'
                   '\\box0\\kern4bp}\\kern4bp}\\hoffset=-1in\\voffset=-1in\n'
                   '\\pdfpagewidth=\\wd0\\pdfpageheight=\\dimexpr\\ht0+\\dp0'
                   '\\relax\\shipout\\box0\n')
    source += '\\end{document}\n'
    open(os.path.join(work, 'web.tex'), 'w').write(source)
    with open(os.path.join(work, 'web-labels.tex'), 'w') as out:
        out.write('\\makeatletter\n')
        for key, number in numbers.items():
            out.write(f'\\expandafter\\gdef\\csname r@{key}\\endcsname'
                      f'{{{{{number}}}{{0}}{{}}{{}}{{}}}}\n')
        out.write('\\makeatother\n')
    done = subprocess.run(['pdflatex', '-interaction=nonstopmode',
                           f'-output-directory={work}', 'web.tex'],
                          env={**os.environ, 'TEXINPUTS':
                               f'{work}:{os.environ.get("TEXINPUTS", "")}'},
                          stdout=subprocess.DEVNULL)
    if done.returncode:
        warnings.append(f'errors of LaTeX, in {work}/web.log')
    for i, (file, _) in enumerate(drawings, 1):
        subprocess.run(['pdftocairo', '-svg', '-f', str(i), '-l', str(i),
                        os.path.join(work, 'web.pdf'),
                        os.path.join(OUT, file)], check=True)


# ---- pages

def pandoc(s):
    # What pandoc's reader of formulas does not know.
    s = re.sub(r'\\(?:Big|bigg|Bigg)([lr])(?![a-z])', r'\\big\1', s)
    s = re.sub(r'\\Big(?![a-zA-Z])', '', s)
    s = re.sub(r'\\textsc(?=\{)', r'\\mathrm', s)
    s = re.sub(r'\\!|\\mathopen|\\mathclose', '', s)
    done = subprocess.run(['pandoc', '-f', 'latex', '-t', 'html', '--mathml',
                           '--shift-heading-level-by=1', '--wrap=none'],
                          input=s, text=True,
                          capture_output=True)
    if done.returncode:
        sys.exit('pandoc: ' + done.stderr)
    for line in done.stderr.splitlines():
        warnings.append('pandoc: ' + line)
    s = done.stdout.replace('<math display="block"',
                            '<math tabindex="0" display="block"')
    s = re.sub(r'<th[^>]*></th>', '<td></td>', s)
    # A head of a table that is a formula alone is no head to a screen reader.
    return re.sub(r'<th([^>]*)>(<math(?:(?!</th>).)*</math>)</th>',
                  r'<td\1>\2</td>', s)


def page(title, sidebar, body):
    return f'''<!DOCTYPE html>
<html lang="en-GB"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title>
<link rel="stylesheet" href="web.css"><link rel="icon" href="data:,">
<script src="web.js" defer></script>
</head><body><p class="top"><a href="#contents">Contents</a></p>
<main id="main">
{body}
</main>
<nav id="contents" aria-label="Contents">
{sidebar}
</nav></body></html>
'''


class Book:
    """The parts and chapters of the master, and what follows them."""

    def __init__(self):
        self.parts, self.chapters, self.titles = [], {}, {}
        self.drawings, self.intros = [], {}
        text = find(MASTER + '.tex')
        for m in re.finditer(r'\\part\{([^}]*)\}(?:\s*\\label\{([^}]*)\})?'
                             r'|\\include\{([^}]*)\}', text):
            if m[1] or not self.parts:
                self.parts.append((m[1] or 'Chapters', m[2], []))
                intro = text.rfind('\\partintro{', 0, m.start())
                if intro > 0:
                    self.intros[m[1]] = group(text, intro + 10)[0]
            if m[3]:
                self.parts[-1][2].append(m[3])
                self.chapters[m[3]] = None

    def read(self):
        for name in [MASTER, *self.chapters]:
            read_aux(name)
        read_measured()
        titles = {}
        for name in self.chapters:
            text = find(name + '.tex')
            titles[name], _ = group(text, text.index('\\chapter{') + 8)
            key = re.search(r'\\label\{(chap:[^}]*)\}', text)[1]
            self.chapters[name] = Chapter(name, numbers.get(key, '?'),
                                          self.drawings)
        for name, title in titles.items():
            chapter = self.chapters[name]
            self.titles[name] = chapter.number + ' ' + re.sub(
                r'<[^>]*>', '', pandoc(chapter.words(title))).strip()

    def contents(self, here=None):
        out = '<ol class="contents">'
        for title, key, names in self.parts:
            place = f' id="{key}"' if key and here == 'index' else ''
            out += f'<li{place}>{title}'
            if here == 'index' and title in self.intros:
                words = self.chapters[names[0]].words(self.intros[title])
                out += pandoc(words)
            out += '<ul>'
            for name in names:
                out += '<li>' + entry(name, self.titles[name], here)
                if name == here:
                    out += '<ul>' + ''.join(
                        f'<li><a href="#{key}">{web_reader.text(title)}</a></li>'
                        for key, title in NUMBERED.findall(
                            self.chapters[name].body)) + '</ul>'
                out += '</li>'
            out += '</ul></li>'
        return out + '<li>To look up<ul>' + ''.join(
            f'<li>{entry(name, title, here)}</li>'
            for name, title in LOOKED_UP.items()) + '</ul></li></ol>'

    def pages(self):
        """The title and body of each page."""
        made = {}
        around = ['index', *self.chapters, *LOOKED_UP]
        for i, (name, chapter) in enumerate(self.chapters.items(), 1):
            links = ' · '.join(f'<a href="{n}.html">{word}</a>' for word, n in [
                ('Before', around[i - 1]), ('Contents', 'index'),
                ('Next', around[i + 1])])
            made[name] = (self.titles[name], chapter.html()
                          + f'<p class="around">{links}</p>')
        for name, body in [
                ('bibliography', bibliography()),
                ('subjects', subjects(self.chapters.values())),
                ('identifiers', index_of_identifiers()),
                ('files', files())]:
            if body:
                made[name] = (LOOKED_UP[name], body)
            else:
                del LOOKED_UP[name]
        made['index'] = (MASTER, door(self.chapters) + self.contents('index'))
        return made


NUMBERED = re.compile(r'<h2[^>]*><span id="([^"]*)"></span>'
                      r'((?:\d+|[A-Z])\..*?)</h2>')
LOOKED_UP = {'bibliography': 'Bibliography', 'subjects': 'Index of subjects',
             'identifiers': 'Index of identifiers', 'files': 'Files'}


def door(chapters):
    """What the README says first, the way in, and the curves to play with."""
    with open(os.path.join(os.path.dirname(WEB), 'README.md')) as file:
        text, _, _ = file.read().partition('\n## Run it')
    _, _, text = text.partition('\n')
    made = subprocess.run(['pandoc', '-f', 'gfm', '-t', 'html'], input=text,
                          capture_output=True, text=True, check=True).stdout

    def picture(m):
        source = os.path.join(os.path.dirname(WEB), m[1])
        shutil.copy(source, os.path.join(OUT, 'figures'))
        return f'src="figures/{os.path.basename(source)}"'
    made = re.sub(r'src="([^"]*)"', picture, made)
    if 'tiny' in chapters:
        made += ('<p><a href="tiny.html">Begin here: a path tracer in ten '
                 'pages</a></p>')
    if 'time_to_error' in chapters:
        made += ('<figure>' + web_play.play('fig:efficiency', PATHS, OUT)
                 + '<figcaption>Error against time beside a path tracer on '
                 'Embree.</figcaption></figure>')
    return made


def entry(name, title, here):
    mark = ' aria-current="page"' if name == here else ''
    return f'<a href="{name}.html"{mark}>{title}</a>'


def bibliography():
    entries = re.split(r'\\bibitem\{([^}]*)\}', re.sub(
        r'\\newblock|\\end\{thebibliography\}', '', find(MASTER + '.bbl')))[1:]
    return ''.join(
        f'<div id="{key}" class="source"><b>[{cited.get(key, "?")}]</b> '
        + pandoc(text) + '</div>'
        for key, text in zip(entries[::2], entries[1::2]))


def subjects(chapters):
    """Where each subject is spoken of, by section; or what to see."""
    where, sees = {}, {}
    for chapter in chapters:
        section = chapter.number
        for m in re.finditer(r'<h2[^>]*><span[^>]*></span>((?:\d+|[A-Z])\.\d+) '
                             r'|id="subject-(\d+)"', chapter.body):
            section = m[1] or section
            if m[2]:
                entry = chapter.subjects[int(m[2]) - 1]
                where.setdefault(entry, {}).setdefault(
                    section, f'<a href="{chapter.name}.html#subject-{m[2]}">'
                    f'{section}</a>')
        for entry in chapter.subjects:
            if '|see' in entry:
                entry, _, other = entry.partition('|see')
                sees[entry] = other[1:-1]

    def place(entry):
        return 'entry-' + re.sub(r'\W+', '-', entry)
    return (where or '') and web_reader.by_letter(
        [(entry, f'<span id="{place(entry)}">'
          f'{html.escape(", ".join(entry.split("!")))}</span>: '
          + ', '.join(links.values())) for entry, links in where.items()]
        + [(entry, f'{html.escape(entry)}: see <a href="#{place(other)}">'
            f'{html.escape(other)}</a>') for entry, other in sees.items()])


def index_of_identifiers():
    """Definitions are bold, as they are underlined in the PDF."""
    out = []
    for key, name in identifiers.items():
        links = [anchor(label) if use else f'<b>{anchor(label)}</b>'
                 for use, label in sorted(set(places.get(key, ())))]
        out.append((name, f'<code>{name}</code>: {", ".join(links)}'))
    return ('<p>Bold labels are those of the chunks that define the identifier; '
            'the others use it.</p>' + web_reader.by_letter(out))


def files():
    """Each file of the program with the chunks that its lines come from."""
    out = []
    for name in program.names:
        ranges = program.ranges(name)
        if not ranges:
            continue
        out.append(f'<h2 id="{name}">{name}</h2>\n<ol class="lines">')
        for first, last, label in ranges:
            if label is None:
                warnings.append(f'{name}:{first}: from no chunk')
                continue
            lines = str(first) if first == last else f'{first}–{last}'
            out.append(f'<li>{lines} {anchor(label)}</li>')
        out.append('</ol>')
    return ('<p>The lines of each file of the program, and the chunks that they '
            'come from.</p>' + '\n'.join(out))


def main():
    os.makedirs(os.path.join(OUT, 'figures'), exist_ok=True)
    book = Book()
    book.read()
    pages = book.pages()
    draw_all(book.drawings)
    bodies = {name: f'<h1>{title}</h1>\n{body}\n'
              for name, (title, body) in pages.items()}
    write('search-data.js', web_reader.search(
        {name: bodies[name] for name in ['bibliography', *book.chapters]}))
    for name, script in web_reader.previews(bodies):
        write(f'preview-{name}.js', script)
    bodies['search'] = ('<h1>Search</h1>\n<p id="found" role="status">The search '
                        'needs JavaScript; the indexes do not.</p>\n')
    for name, body in bodies.items():
        title = pages.get(name, ('Search',))[0]
        sidebar = '' if name == 'index' else book.contents(name)
        write(name + '.html', page(title, sidebar, body))
    warnings.extend(f'{name} differs when copied from the pages'
                    for name in program.differs(bodies.values()))
    check()
    for line in sorted(set(warnings)):
        print('html:', line, file=sys.stderr)
    if warnings:
        sys.exit(f'html: {len(set(warnings))} faults')


def check():
    """Each link leads to a page, and to a place on it, that is there once."""
    ids, hrefs = {}, []
    for name in sorted(os.listdir(OUT)):
        if name.endswith('.html'):
            text = open(os.path.join(OUT, name), encoding='utf-8').read()
            found = re.findall(r'\bid="([^"]*)"', text)
            ids[name] = set(found)
            for twice in {x for x in found if found.count(x) > 1}:
                warnings.append(f'{name}: twice the place {twice}')
            hrefs += [(name, html.unescape(x))
                      for x in re.findall(r'(?:href|src)="([^"]*)"', text)]
    for name, href in hrefs:
        target, _, place = href.partition('#')
        target = target or name
        if re.match(r'https?:|data:', href):
            continue
        if not os.path.exists(os.path.join(OUT, target)):
            warnings.append(f'{name}: no page {href}')
        elif place and place not in ids.get(target, ()):
            warnings.append(f'{name}: no place {href}')


def write(name, text):
    with open(os.path.join(OUT, name), 'w', encoding='utf-8') as out:
        out.write(text)


main()
