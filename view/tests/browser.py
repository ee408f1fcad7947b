#!/usr/bin/env python3
"""Drives ptview in a headless Chromium, as a person would.

usage: browser.py PTVIEW FOLDER SCENE [OPTION...]
       browser.py --rates PTVIEW SCENE...
       browser.py --screen FILE.png PTVIEW SCENE [OPTION...]

Turns, walks, sets, copies and renders, compares what is rendered with what the
copied command writes, and prints how fast images come. Screenshots go to the
FOLDER. With --rates, prints a CSV of how fast images of scenes come; a SCENE is
then a path without ".obj", beside which lies a ".view" with the options of the
camera. With --screen, saves a picture of the page. Exits with 77 if there is no Chromium.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import base64
import ctypes
import http.client
import json
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time


LIBC = ctypes.CDLL(None)
PR_SET_PDEATHSIG = 1


def shed_what_is_inherited():
    """In a child: no signal is ignored because this script was started so, and
    Linux kills it when this script ends, however it does."""
    for number in signal.SIGHUP, signal.SIGINT, signal.SIGTERM:
        signal.signal(number, signal.SIG_DFL)
    if sys.platform == 'linux':
        LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


class Browser:
    """A Chromium that is spoken to over a pipe, with one page."""

    def __init__(self, program, folder):
        ours, theirs = os.pipe(), os.pipe()

        def place():
            shed_what_is_inherited()
            # The browser reads from 3 and writes to 4.
            ends = os.dup(ours[0]), os.dup(theirs[1])
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self.process = subprocess.Popen(
            [program, '--headless=new', '--remote-debugging-pipe',
             '--no-sandbox', '--disable-gpu', '--no-first-run',
             f'--user-data-dir={folder}'],
            preexec_fn=place, close_fds=False, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(ours[0])
        os.close(theirs[1])
        self.out, self.reader = ours[1], os.fdopen(theirs[0], 'rb')
        self.number, self.session, self.rest = 0, None, b''

    def call(self, method, **params):
        self.number += 1
        message = {'id': self.number, 'method': method, 'params': params}
        if self.session:
            message['sessionId'] = self.session
        os.write(self.out, json.dumps(message).encode() + b'\0')
        while True:
            while b'\0' not in self.rest:
                self.rest += self.reader.read1(1 << 20)
            text, _, self.rest = self.rest.partition(b'\0')
            answer = json.loads(text)
            if answer.get('id') == self.number:
                if 'error' in answer:
                    raise RuntimeError(f'{method}: {answer["error"]}')
                return answer['result']

    def open(self, address):
        target = self.call('Target.createTarget', url='about:blank')
        attached = self.call('Target.attachToTarget', flatten=True,
                             targetId=target['targetId'])
        self.session = attached['sessionId']
        self.call('Page.enable')
        self.call('Page.navigate', url=address)
        return target['targetId']

    def run(self, script):
        """The value of an expression in the page."""
        result = self.call('Runtime.evaluate', expression=script,
                           awaitPromise=True, returnByValue=True)
        if 'exceptionDetails' in result:
            raise RuntimeError(result['exceptionDetails'])
        return result['result'].get('value')

    def wait(self, script, seconds=20):
        """Waits until an expression holds; returns it and the seconds."""
        began = time.monotonic()
        while time.monotonic() < began + seconds:
            if value := self.run(script):
                return value, time.monotonic() - began
            time.sleep(0.01)
        raise TimeoutError(script)

    def mouse(self, kind, x, y, **more):
        self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, **more)

    def key(self, key):
        for kind in 'keyDown', 'keyUp':
            self.call('Input.dispatchKeyEvent', type=kind, key=key, text=key
                      if kind == 'keyDown' and len(key) == 1 else '')

    def screen(self, path, width, dark):
        """Saves a picture of the page."""
        self.call('Emulation.setDeviceMetricsOverride', width=width,
                  height=900, deviceScaleFactor=1, mobile=False)
        scheme = 'dark' if dark else 'light'
        self.call('Emulation.setEmulatedMedia', features=[
            {'name': 'prefers-color-scheme', 'value': scheme}])
        time.sleep(0.3)
        shot = self.call('Page.captureScreenshot', captureBeyondViewport=True)
        with open(path, 'wb') as file:
            file.write(base64.b64decode(shot['data']))


def check(what, holds):
    """Says what was looked for, and ends the run if it is not there."""
    print('ok  ' if holds else 'FAIL', what, flush=True)
    if not holds:
        sys.exit(1)


TEXT = '(document.getElementById("{}")?.textContent ?? "")'
STATUS, COMMAND = TEXT.format('status'), TEXT.format('command')
# The command without the error, which becomes smaller while nobody moves.
VIEW = COMMAND + '.replace(/--error=\\S+ /, "")'
# Counts images by the moment at which they are put on the canvas.
COUNT = '''window.shown = 0; window.last = null;
const put = CanvasRenderingContext2D.prototype.putImageData;
CanvasRenderingContext2D.prototype.putImageData = function (image, ...more) {
  if (image.width !== window.width || moved(image)) window.shown++;
  window.width = image.width;
  return put.call(this, image, ...more);
};
function moved({ data }) {
  let sum = 0;
  for (let i = 0; i < data.length; i += 68) sum = (sum * 31 + data[i]) | 0;
  const is = sum !== window.last;
  window.last = sum;
  return is;
}
navigator.clipboard.writeText = async (text) => { window.copied = text; };
true'''


def turn(browser, seconds):
    """Drags to and fro; returns the images that were shown in a second."""
    browser.mouse('mousePressed', 400, 400, button='left', buttons=1,
                  clickCount=1)
    began, shown, step = time.monotonic(), browser.run('window.shown'), 0
    while time.monotonic() < began + seconds:
        step += 1
        x = 400 + (step % 40 if step % 80 < 40 else 40 - step % 40)
        browser.mouse('mouseMoved', x, 400, button='left', buttons=1)
        time.sleep(0.01)
    shown = browser.run('window.shown') - shown
    seconds = time.monotonic() - began
    browser.mouse('mouseReleased', x, 400, button='left', clickCount=1)
    return shown / seconds


def refused(host, path, **headers):
    connection = http.client.HTTPConnection(host)
    connection.request('GET', path, headers=headers)
    return connection.getresponse().status == 404


def processor_seconds(process):
    with open(f'/proc/{process}/stat') as file:
        fields = file.read().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def drive(browser, viewer, address, folder, axe):
    """What a person would do."""
    host, token = address.removeprefix('http://').strip('/').split('/')
    page = browser.open(address)
    browser.wait(f'{STATUS}.includes("spp")', 60)
    browser.run(COUNT)
    check('no request without the secret', refused(host, '/'))
    check('none for another host',
          refused(host, f'/{token}/', Host='evil.example'))
    check('no other path', refused(host, f'/{token}/../Cargo.toml'))
    for length in 2000, 10 ** 18:
        with socket.create_connection(host.split(':')) as connection:
            connection.sendall(b'POST / HTTP/1.1\r\nHost: a\r\n'
                               b'Content-Length: %d\r\n\r\n' % length)
    check('no body is waited for that does not come', refused(host, '/'))
    # Turn, and wait for the image
    before = browser.run(VIEW)
    rate = turn(browser, 3)
    _, pause = browser.wait('window.width >= 640', 60)
    print(f'     {rate:.1f} images a second, the first whole one after '
          f'{pause:.2f} s')
    check('images follow a drag', rate > 3)
    check('a drag moves the camera', browser.run(VIEW) != before)
    # Browsers differ in the units of a movement
    browser.run("""image = document.getElementById("image");
        image.setPointerCapture = () => {};
        drag = (type, clientX, movementX) => image.dispatchEvent(
          new PointerEvent(type, { clientX, movementX, buttons: 1 }));
        drag("pointerdown", 300, 0)""")
    time.sleep(0.5)
    before = browser.run(VIEW)
    browser.run('drag("pointermove", 350, 100)')
    browser.wait(f'{VIEW} !== {json.dumps(before)}')
    browser.run('drag("pointermove", 300, -50)')
    browser.wait(f'{VIEW} === {json.dumps(before)}')
    check('a drag to and fro comes back', True)
    for name, change in (
            ('a key walks', lambda: browser.key('w')),
            ('an arrow turns', lambda: browser.key('ArrowLeft')),
            ('the wheel comes nearer', lambda: browser.mouse(
                'mouseWheel', 300, 300, deltaX=0, deltaY=-200)),
            ('a digit shows a side', lambda: browser.key('1')),
            ('a field sets the albedo', lambda: browser.run(
                'field = document.forms[0].elements["-r"]; field.value = 0.5;'
                'field.dispatchEvent(new Event("change", { bubbles: true }));'
            ))):
        before = browser.run(VIEW)
        change()
        browser.wait(f'{VIEW} !== {json.dumps(before)}')
        check(name, True)
    browser.wait('/-r 0.5/.test(' + VIEW + ')')
    browser.run('field.value = 2;'
                'field.dispatchEvent(new Event("change", { bubbles: true }))')
    fault, _ = browser.wait(TEXT.format('fault'))
    check(f'a fault is told: {fault}', 'albedo between 0 and 1' in fault)
    walked = browser.run(VIEW)
    browser.key('4')
    browser.key('w')
    browser.wait(f'{VIEW} !== {json.dumps(walked)} && '
                 + TEXT.format('fault') + ' === ""')
    check('what cannot be shown is not kept, nor is a side', True)
    browser.run('field.value = 0.6;'
                'field.dispatchEvent(new Event("change", { bubbles: true }))')
    browser.wait('/-r 0.6/.test(' + VIEW + ')')
    # From above, where up is another axis, to the front again
    for key, place in ('5', 'zenith'), ('1', '-u 0,1,0'):
        browser.key(key)
        browser.wait(f'{VIEW}.includes({json.dumps(place)})')
    check('the zenith stays', '--zenith' not in browser.run(VIEW))
    browser.run('day = document.getElementById("day"); day.value = 9;'
                'day.dispatchEvent(new Event("input", { bubbles: true }));'
                'day.dispatchEvent(new Event("change", { bubbles: true }))')
    browser.wait(f'/--direct=4/.test({COMMAND})'
                 f' && /--sun=125.3,30.0/.test({COMMAND})')
    check('a slider moves the sun', True)
    # Copy the command and render
    browser.run('for (const [name, value] of [["-d", "64x48"],'
                '["--error", "0.02"]]) {'
                'const field = document.forms[0].elements[name];'
                'field.value = value; field.dispatchEvent('
                'new Event("change", { bubbles: true })); }')
    browser.wait('/64x48/.test(' + COMMAND + ') && /0.02/.test(' + COMMAND + ')')
    browser.run('document.getElementById("copy").click()')
    command, _ = browser.wait('window.copied')
    browser.run('document.getElementById("render").click()')
    browser.wait('!!document.querySelector("#files a")', 60)
    connection = http.client.HTTPConnection(host)
    connection.request('GET', f'/{token}/image.png')
    rendered = connection.getresponse().read()
    words = shlex.split(command)
    pt = os.path.join(os.path.dirname(viewer.args[0]), 'pt')
    with tempfile.TemporaryDirectory() as place:
        words[-3] = os.path.join(place, 'image.exr')
        words[-1] = os.path.join(place, 'image.png')
        subprocess.run([pt, *words[1:], '-q'], check=True)
        with open(words[-1], 'rb') as file:
            check(f'the bytes of: {command}', file.read() == rendered)
    # Look at the page
    for width in 1400, 400:
        for dark in False, True:
            name = f'{width}-{"dark" if dark else "light"}.png'
            browser.screen(os.path.join(folder, name), width, dark)
            wide = browser.run('document.documentElement.scrollWidth')
            check(f'{name}: nothing is cut off', wide <= width)
            if axe:
                browser.run(axe)
                found = browser.run('axe.run().then(({ violations }) =>'
                                    'violations.map(({ id }) => id).join())')
                check(f'{name}: axe finds nothing {found}', not found)
    # Look at it in two pages, and close both: the work stops within a second
    browser.session = None
    second = browser.open(address)
    browser.wait(f'{STATUS}.includes("spp")')
    check('a second page shows the same', browser.run(COMMAND) == command)
    browser.session = None
    for target in page, second:
        browser.call('Target.closeTarget', targetId=target)
    time.sleep(1)
    before = processor_seconds(viewer.pid)
    time.sleep(0.5)
    check('a closed page stops the work',
          processor_seconds(viewer.pid) - before < 0.05)


def rates(browser, viewer, address, scene):
    """A line of a CSV: how fast images come while the view turns, the seconds
    from then to the first whole image, and the most memory."""
    browser.open(address)
    browser.wait(f'{STATUS}.includes("spp")', 120)
    browser.run(COUNT)
    rate = turn(browser, 5)
    width = browser.run('window.width')
    _, pause = browser.wait('window.width >= 640', 60)
    with open(f'/proc/{viewer.pid}/status') as file:
        peak = next(int(line.split()[1]) for line in file if 'VmHWM' in line)
    name = os.path.basename(scene)
    print(f'{name},{rate:.1f},{width},{pause:.2f},{peak // 1000}', flush=True)


def screen(browser, viewer, address, file):
    """Saves a picture of the page after ten seconds of rendering."""
    browser.open(address)
    browser.wait(f'{STATUS}.includes("spp")', 120)
    time.sleep(10)
    browser.screen(file, 1100, False)


def serve(program, words, chromium, work, *more):
    """Works with a page of ptview in a browser."""
    viewer = subprocess.Popen([program, *words], stdout=subprocess.PIPE,
                              text=True, env={**os.environ, 'DISPLAY': ''},
                              preexec_fn=shed_what_is_inherited)
    try:
        address = viewer.stdout.readline().strip()
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
            browser = Browser(chromium, place)
            try:
                work(browser, viewer, address, *more)
            finally:
                browser.process.kill()
                browser.process.wait()
    finally:
        viewer.terminate()
        status = viewer.wait()
    return status


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__.partition('\n\nCopyright')[0])
    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if not chromium:
        print('skipped: browser.py: there is no Chromium')
        sys.exit(77)
    if sys.argv[1] == '--rates':
        print('scene,images_a_second,width,first_whole_seconds,megabytes')
        for scene in sys.argv[3:]:
            with open(scene + '.view') as file:
                words = [scene + '.obj', *file.read().split(), '-r', '0.8']
            serve(sys.argv[2], words, chromium, rates, scene)
        return
    if sys.argv[1] == '--screen':
        file, program, *words = sys.argv[2:]
        serve(program, words, chromium, screen, file)
        return
    program, folder, *words = sys.argv[1:]
    axe = os.environ.get('AXE')
    if axe:
        with open(axe) as file:
            axe = file.read()
    os.makedirs(folder, exist_ok=True)
    status = serve(program, words, chromium, drive, folder, axe)
    check('a signal ends ptview', status == 0)


if __name__ == '__main__':
    main()
