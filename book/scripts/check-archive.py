#!/usr/bin/env python3
"""Can the book be read in fifty years? Does its PDF keep what PDF/A-2u asks?

usage: check-archive.py BOOK.pdf

Reads the objects of the file itself, with Python's own library, and checks the
rules of ISO 19005-2, level U, that LaTeX could break: the identifier of the
file; the description in XMP, and that it agrees with the dictionary of
information; the output intent and its colour profile; no colours that it does
not cover; fonts inside the file, with what their codes mean in Unicode; links
that are printed, and that lead to a place, an address, or a place in another
volume that lies beside the file; no programs, no encryption, nothing outside. This is less than a complete validator does.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import os
import re
import sys
import zlib
from xml.etree import ElementTree

RDF = '{http://www.w3.org/1999/02/22-rdf-syntax-ns#}'
XMP = {
    'dc': '{http://purl.org/dc/elements/1.1/}',
    'pdf': '{http://ns.adobe.com/pdf/1.3/}',
    'xmp': '{http://ns.adobe.com/xap/1.0/}',
    'xmpRights': '{http://ns.adobe.com/xap/1.0/rights/}',
    'pdfaid': '{http://www.aiim.org/pdfa/ns/id/}',
}
SAME = {b'Title': 'dc:title', b'Author': 'dc:creator',
        b'Subject': 'dc:description', b'Keywords': 'pdf:Keywords',
        b'Producer': 'pdf:Producer', b'Creator': 'xmp:CreatorTool'}
FORBIDDEN = (b'JavaScript', b'JS', b'Launch', b'Sound', b'Movie', b'ResetForm',
             b'ImportData', b'Rendition', b'Trans3D', b'XFA', b'AA',
             b'EmbeddedFiles', b'LZWDecode', b'DeviceCMYK', b'PS', b'OPI')


class Book:
    """The objects of a PDF file: dictionaries, and streams unpacked."""

    def __init__(self, data):
        self.data, self.objects, self.streams = data, {}, {}
        at = 0
        while start := re.compile(rb'(\d+) (\d+) obj\b').search(data, at):
            number = int(start.group(1))
            end = data.index(b'endobj', start.end())
            stream = re.compile(rb'stream\r?\n').search(data, start.end(), end)
            if stream:
                head = data[start.end():stream.start()]
                length = int(re.search(rb'/Length (\d+)', head).group(1))
                body = data[stream.end():stream.end() + length]
                end = data.index(b'endobj', stream.end() + length)
                self.streams[number] = self.unpacked(head, body)
                self.objects[number] = head
            else:
                self.objects[number] = data[start.end():end]
            at = end
        for number, head in list(self.objects.items()):
            if b'/ObjStm' in head and number in self.streams:
                self.unpack_objects(head, self.streams[number])
        self.trailers = [head for head in self.objects.values()
                         if re.search(rb'/Type\s*/XRef\b', head)]
        self.trailers += re.findall(rb'trailer(.*?)startxref', data, re.S)

    @staticmethod
    def unpacked(head, body):
        if re.search(rb'/Filter\s*\[?\s*/FlateDecode', head) \
                and b'/Image' not in head:
            return zlib.decompress(body)
        return body

    def unpack_objects(self, head, text):
        first = int(re.search(rb'/First (\d+)', head).group(1))
        numbers = [int(x) for x in text[:first].split()]
        starts = numbers[1::2] + [len(text) - first]
        for i, number in enumerate(numbers[::2]):
            self.objects[number] = text[first + starts[i]:first + starts[i + 1]]

    def of_type(self, name):
        kind = re.compile(rb'/Type\s*/' + name + rb'(?![A-Za-z])')
        return {n: o for n, o in self.objects.items() if kind.search(o)}

    def reference(self, where, key):
        """The number of the object to which a key refers, or None."""
        found = re.search(rb'/' + key + rb'\s*\[?\s*(\d+) 0 R', where)
        return int(found.group(1)) if found else None


def text_of(raw):
    """A string of PDF, in parentheses or hexadecimal, as text."""
    if raw.startswith(b'<'):
        raw = bytes.fromhex(raw[1:-1].decode())
    else:
        raw = re.sub(rb'\\([0-7]{3})', lambda m: bytes([int(m.group(1), 8)]),
                     raw[1:-1])
        raw = re.sub(rb'\\(.)', rb'\1', raw, flags=re.S)
    if raw.startswith(b'\xfe\xff'):
        return raw[2:].decode('utf-16-be')
    return raw.decode('latin-1')


def without_strings(text):
    return re.sub(rb'\((?:\\.|[^\\()])*\)', b'()', text, flags=re.S)


def check_file(book, fault):
    if not re.match(rb'%PDF-1\.[0-7]\n%[\x80-\xff]{4}', book.data):
        fault('the file does not begin with %PDF-1.7 and a binary comment')
    if not re.search(rb'%%EOF\r?\n?\Z', book.data):
        fault('something follows the end of the file')
    for trailer in book.trailers:
        if not re.search(rb'/ID\s*\[\s*[<(]', trailer):
            fault('the file has no identifier')
        if b'/Encrypt' in trailer:
            fault('the file is encrypted')
    for number, item in book.objects.items():
        plain = without_strings(item)
        for word in FORBIDDEN:
            if re.search(rb'/' + word + rb'(?![A-Za-z0-9])', plain):
                fault(f'object {number} has /{word.decode()}')
        if re.search(rb'/Interpolate\s+true', plain):
            fault(f'the image {number} asks for interpolation')
        if b'/F ' in plain and number in book.streams:
            fault(f'the stream {number} lies in another file')


def check_metadata(book, fault):
    """The description in XMP; it agrees with the older one."""
    catalog = next(iter(book.of_type(rb'Catalog').values()))
    if not re.search(rb'/Lang\s*[(<]', catalog):
        fault('the language is not told')
    number = book.reference(catalog, rb'Metadata')
    if number is None or b'/Filter' in book.objects[number]:
        return fault('there is no XMP description in plain text')
    root = ElementTree.fromstring(book.streams[number])
    told = {}
    for name, space in XMP.items():
        for node in root.iter():
            if node.tag.startswith(space):
                items = [i.text for i in node.iter(RDF + 'li')] or [node.text]
                told[f'{name}:{node.tag[len(space):]}'] = ', '.join(items)
    if (told.get('pdfaid:part'), told.get('pdfaid:conformance')) != ('2', 'U'):
        fault('the XMP description does not say PDF/A-2u')
    if 'GPL-3.0-or-later' not in told.get('dc:rights', ''):
        fault('the XMP description does not name the licence')
    info = next((book.objects[n] for t in book.trailers
                 if (n := book.reference(t, rb'Info')) is not None), b'')
    for key, name in SAME.items():
        found = re.search(
            rb'/' + key + rb'\s*(\((?:\\.|[^\\()])*\)|<[0-9A-Fa-f]*>)', info,
            re.S)
        value = text_of(found.group(1)) if found else None
        if not value or value != told.get(name):
            fault(f'{key.decode()} is {value!r}, but {name} '
                  f'{told.get(name)!r}')
    intents = book.reference(catalog, rb'OutputIntents')
    intent = book.objects.get(intents, b'')
    profile = book.streams.get(book.reference(intent, rb'DestOutputProfile'))
    if b'/GTS_PDFA1' not in intent or profile is None:
        return fault('there is no output intent with a profile')
    if profile[36:40] != b'acsp' or profile[16:20] != b'RGB ' \
            or profile[8] > 4:
        fault('the profile is no ICC profile of RGB, version 4 at most')


def check_fonts(book, fault):
    fonts = book.of_type(rb'Font')
    for number, font in fonts.items():
        name = re.search(rb'/BaseFont\s*/([^\s/]+)', font)
        name = name.group(1).decode() if name else f'font {number}'
        descriptor = book.objects.get(book.reference(font, rb'FontDescriptor'))
        if descriptor is None or not re.search(rb'/FontFile[23]?\s', descriptor):
            fault(f'{name} is not in the file')
        meanings = codes_with_meaning(
            book.streams.get(book.reference(font, rb'ToUnicode'), b''))
        for code, glyph in codes_of(book, font).items():
            if code not in meanings:
                fault(f'{name} does not say what its code {code} means '
                      f'({glyph})')
    return len(fonts)


def codes_of(book, font):
    """The codes that a font has, each with the name of its glyph."""
    encoding = book.objects.get(book.reference(font, rb'Encoding'), b'')
    names = re.search(rb'/Differences\s*\[(.*?)\]', encoding, re.S)
    if not names:
        ends = [int(re.search(rb'/' + key + rb'\s+(\d+)', font).group(1))
                for key in (b'FirstChar', b'LastChar')]
        return {code: '' for code in range(ends[0], ends[1] + 1)}
    code, codes = 0, {}
    for word in re.findall(rb'/?[^\s/]+', names.group(1)):
        if word.startswith(b'/'):
            codes[code] = word.decode()
        code = code + 1 if word.startswith(b'/') else int(word)
    return codes


def codes_with_meaning(text):
    """The codes that a ToUnicode map maps."""
    codes = set()
    for kind, lines in re.findall(rb'beginbf(char|range)(.*?)endbf', text, re.S):
        numbers = [int(x, 16) for x in re.findall(rb'<([0-9A-Fa-f]+)>', lines)]
        if kind == b'char':
            codes.update(numbers[::2])
        else:
            for first, last in zip(numbers[::3], numbers[1::3]):
                codes.update(range(first, last + 1))
    return codes


def read(path):
    with open(path, 'rb') as file:
        return Book(file.read())


def check_links(book, folder, fault):
    links, volumes = book.of_type(rb'Annot'), {}
    for number, link in links.items():
        flags = re.search(rb'/F\s+(\d+)', link)
        if not flags or int(flags.group(1)) & 0b100111 != 4:
            fault(f'the annotation {number} is not printed')
        if not re.search(rb'/Subtype\s*/Link\b', link):
            fault(f'the annotation {number} is no link')
        if far := re.search(rb'/F\((.*?)\)/S/GoToR/D(\(.*?\))>>', link, re.S):
            name, place = far.groups()
            if name not in volumes:
                other = read(os.path.join(folder, name.decode()))
                volumes[name] = {place for text in other.objects.values()
                                 if b'/Limits' in text for place in
                                 re.findall(rb'\((?:\\.|[^\\()])*\)', text)}
            if place not in volumes[name]:
                fault(f'the link {number} leads to no {place} of {name}')
        elif not re.search(rb'/(S\s*/(GoTo|URI)\b|Dest)', link):
            fault(f'the link {number} leads nowhere')
    return len(links)


def check_colours(book, fault):
    """No page mixes inks: k and K choose CMYK."""
    for number, page in book.of_type(rb'Page').items():
        content = book.streams.get(book.reference(page, rb'Contents'), b'')
        if re.search(rb'(?:[\d.]+ ){4}[kK]\s', without_strings(content)):
            fault(f'the page in object {number} has colours in CMYK')


def main(arguments):
    if len(arguments) != 1:
        sys.exit(__doc__)
    book = read(arguments[0])
    faults = []
    check_file(book, faults.append)
    check_metadata(book, faults.append)
    fonts = check_fonts(book, faults.append)
    links = check_links(book, os.path.dirname(arguments[0]), faults.append)
    check_colours(book, faults.append)
    for fault in faults[:20]:
        print(f'error: {arguments[0]}: {fault}')
    print(f'{len(book.of_type(rb"Page"))} pages, {fonts} fonts, {links} links '
          f'for PDF/A-2u, {len(faults)} faults')
    sys.exit(1 if faults else 0)


if __name__ == '__main__':
    main(sys.argv[1:])
