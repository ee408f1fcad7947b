"""What a reader looks things up by, for web.py: search, previews, indexes.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import html
import json
import re

HEADING = re.compile(r'<(h[12])[^>]*>(.*?)</\1>', re.S)


def text(s):
    """The words of a piece of a page."""
    s = re.sub(r'<annotation.*?</annotation>', '', s, flags=re.S)
    s = re.sub(r'</(p|li|td|th|figcaption)>', ' ', s)
    return ' '.join(html.unescape(re.sub(r'<[^>]*>', '', s)).split())


def sections(name, body):
    """The sections of a page: address, title, and what stands in them."""
    heads = list(HEADING.finditer(body))
    for head, after in zip(heads, [*heads[1:], None]):
        place = re.search(r'id="([^"]*)"', head[2]) or re.search(
            r'id="([^"]*)"', head[0])
        yield (f'{name}.html' + (f'#{place[1]}' if place else ''),
               text(head[2]), body[head.end():after.start() if after else None])


def search(pages):
    """The script that has all sections: address, title, prose, words of code."""
    out = []
    for name, body in pages.items():
        chapter = text(HEADING.search(body)[2])
        for address, title, s in sections(name, body):
            if title != chapter and not re.match(r'\w+\.\d', title):
                title += f' ({chapter})'
            code = ' '.join(re.findall(r'<pre.*?</pre>', s, re.S))
            words = sorted(set(re.findall(r'[A-Za-z_]\w+', text(code))))
            s = re.sub(r'<(pre|header|footer)\b.*?</\1>|<p class="around">.*', ' ', s,
                       flags=re.S)
            out.append([address, title, text(s), ' '.join(words)])
    return 'searchIn(' + json.dumps(out, ensure_ascii=False) + ');\n'


def bare(s):
    """A piece of a page without places, links and sources of formulas."""
    s = re.sub(r'<annotation.*?</annotation>', '', s, flags=re.S)
    s = re.sub(r'</?a\b[^>]*>| (?:id|tabindex)="[^"]*"', '', s)
    return re.sub(r'<span></span>', '', s)


def cut(s, pattern, most, rest):
    """A preview is cut where it would be long."""
    found = list(re.finditer(pattern, s, re.S))
    if len(found) <= most:
        return s
    return s[:found[most].start()] + rest + s[found[-1].end():]


FORMULA = re.compile(r'(?:<(?:span|div) id="[^"]*">|</(?:span|div)>|</?p>|\s)*'
                     r'(<math[^>]*display="block".*?</math>)', re.S)


def preview(body, key):
    """What a place of a page shows when a link to it is touched."""
    at = body.index(f' id="{key}"')
    start = body.rindex('<', 0, at)
    tag = re.match(r'<(\w+)', body[start:])[1]
    if tag in ('section', 'figure'):
        s = bare(body[start:body.index(f'</{tag}>', start)] + f'</{tag}>')
        s = re.sub(r'<footer>.*?</footer>|<span class="(?:nav|place)">.*?</span>',
                   '', s, flags=re.S)
        if tag == 'section':
            return cut(s, r'[^\n]*\n', 13, '…')
        return cut(s, r'<tr.*?</tr>', 8, '<tr><td>…</td></tr>')
    if m := FORMULA.match(body, start):
        return bare(m[1])
    head = [h for h in HEADING.finditer(body) if h.start() <= start
            and not text(body[h.end():start])]
    after = max(head[-1].end() if head else 0, body.index('>', at) + 1)
    title = f'<p><b>{html.escape(text(head[-1][2]))}</b></p>' if head else ''
    block = re.sub(r'<aside.*?</aside>', '', body[after:after + 9000], flags=re.S)
    said = next(filter(None, map(
        text, re.split(r'</(?:p|li|div|h\d|pre)>', block))), '')
    return title + '<p>' + html.escape(
        said if len(said) < 400 else said[:400].rsplit(' ', 1)[0] + ' …') + '</p>'


def previews(pages):
    """For each page the script with what its places show."""
    wanted = {name: set() for name in pages}
    for name, body in pages.items():
        for page, key in re.findall(r'href="(?:([\w-]+)\.html)?#([^"]+)"', body):
            wanted.get(page or name, set()).add(html.unescape(key))
    for name, keys in wanted.items():
        shown = {key: preview(pages[name], key) for key in sorted(keys)
                 if f' id="{key}"' in pages[name]}
        yield name, ('preview(' + json.dumps(name) + ', '
                     + json.dumps(shown, ensure_ascii=False) + ');\n')


def alternative(figure):
    """The first sentence of a figure's caption, for those who cannot see it."""
    caption = re.search(r'<figcaption>(.*)</figcaption>', figure, re.S)
    said = text(caption[1]) if caption else ''
    m = re.match(r'(\w+ \S+\. .*?\.)(?: |$)', said)
    return html.escape(m[1] if m else said)


def by_letter(entries):
    """An index: entries (sorting key, line) under their first letters."""
    out, letter = [], None
    for key, line in sorted(entries, key=lambda e: (e[0].lower(), e[0])):
        if (first := key[:1].upper()) != letter:
            out.append('</ul>' if letter else '')
            out.append(f'<h2 id="letter-{first}">{html.escape(first)}</h2>\n<ul>')
            letter = first
        out.append(f'<li>{line}</li>')
    return '\n'.join(out) + '</ul>'
