/* web.js -- search, previews and figures to play with, for the books on the web
 *
 * Copyright (C) 2026 litpt contributors
 * Copying and distribution of this file, with or without modification, are
 * permitted in any medium without royalty provided the copyright notice and
 * this notice are preserved. This file is offered as-is, without any warranty.
 *
 * Data comes from scripts, not from requests, which file:// forbids. A page
 * says all that it has to say without this file.
 */
'use strict';

function element(name, properties, ...children) {
  const made = document.createElement(name);
  Object.assign(made, properties);
  made.append(...children);
  return made;
}

const loaded = {};
function load(file) {
  return loaded[file] ??= new Promise((done, failed) =>
    document.head.append(element('script', { src: file, onload: done, onerror: failed })));
}

/* ---- search */

const asked = new URLSearchParams(location.search).get('q') ?? '';
const found = document.getElementById('found');
const form = element('form', { action: 'search.html', role: 'search' },
  element('input', { type: 'search', name: 'q', value: asked, required: true,
    ariaLabel: 'Search the book', placeholder: 'Search the book' }),
  element('button', {}, 'Search'));
if (found) found.before(form);
else document.getElementById('contents').prepend(form);
document.querySelector('.top').append(' · ', element('a', { href: 'search.html' }, 'Search'));

let sections = [];
function searchIn(read) { sections = read; }

/* The text around the first of the words, which is marked. */
function around(text, words) {
  const low = text.toLowerCase();
  const at = Math.min(...words.map(word => low.indexOf(word)).filter(i => i >= 0));
  if (at === Infinity) return [text.slice(0, 160) + ' …'];
  const from = at < 60 ? 0 : text.lastIndexOf(' ', at - 60) + 1;
  const end = at + /^\w*/.exec(text.slice(at))[0].length;
  return [(from ? '… ' : '') + text.slice(from, at),
    element('mark', {}, text.slice(at, end)), text.slice(end, text.indexOf(' ', end + 90) + 1 || undefined) + '…'];
}

async function search() {
  found.textContent = 'Reading the book …';
  await Promise.all([load('lunr.min.js'), load('search-data.js')]);
  await new Promise(requestAnimationFrame);
  const index = lunr(function () {
    this.field('title', { boost: 8 });
    this.field('text');
    this.field('code', { boost: 0.5 });
    this.ref('number');
    sections.forEach(([, title, text, code], number) =>
      this.add({ number, title, text, code }));
  });
  const hits = index.query(query => lunr.tokenizer(asked).forEach(
    token => { query.term(token, {}); }));
  found.textContent = `${hits.length} sections with “${asked}”.`;
  found.after(element('ol', { className: 'hits' }, ...hits.slice(0, 50).map(hit => {
    const [address, title, text, code] = sections[hit.ref];
    const words = Object.keys(hit.matchData.metadata);
    const has = s => words.some(word => s.toLowerCase().includes(word));
    return element('li', {}, element('a', { href: address }, title), element('br', {}),
      ...(has(text) || has(title) ? around(text, words)
        : ['In the code: ', code.split(' ').filter(has).join(', ')]));
  })));
}

if (found) found.textContent = '';
if (found && asked) search();

/* ---- previews of what a link leads to */

const previews = {};
function preview(page, places) { previews[page] = places; }

const card = element('div', { id: 'card', role: 'tooltip', hidden: true });
document.body.append(card);
let touched, timer;

function hide() {
  clearTimeout(timer);
  touched?.removeAttribute('aria-describedby');
  touched = undefined;
  card.hidden = true;
}

async function show(link, page, key) {
  await load(`preview-${page}.js`);
  if (touched !== link || !previews[page]?.[key]) return;
  card.innerHTML = previews[page][key];
  await Promise.allSettled(Array.from(card.querySelectorAll('img'), img => img.decode()));
  if (touched !== link) return;
  card.hidden = false;
  link.setAttribute('aria-describedby', 'card');
  const at = link.getBoundingClientRect();
  const room = document.documentElement;
  card.style.left = Math.max(8, Math.min(at.left, room.clientWidth - card.offsetWidth - 8)) + 'px';
  card.style.top = (at.bottom + card.offsetHeight + 8 < room.clientHeight || at.top < card.offsetHeight
    ? at.bottom : at.top - card.offsetHeight) + 'px';
}

function touch({ target }) {
  const link = target.closest?.('main a[href*="#"]');
  if (link === touched || card.contains(target)) return;
  hide();
  if (!link) return;
  touched = link;
  const page = (link.pathname.split('/').pop() || 'index.html').replace('.html', '');
  timer = setTimeout(show, 200, link, page, decodeURIComponent(link.hash.slice(1)));
}
if (matchMedia('(hover: hover)').matches) document.addEventListener('mouseover', touch);
document.addEventListener('focusin', touch);
document.addEventListener('keydown', ({ key }) => { if (key === 'Escape') hide(); });

/* ---- figures to play with */

function drawn(name, attributes, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  made.append(...children);
  return made;
}

function checkbox(label, checked, change, style = '') {
  return element('label', { style }, element('input', { type: 'checkbox', checked,
    onchange({ target }) { change(target.checked); } }), label);
}

const plays = {
  /* Errors against seconds, of the scenes and runs that are chosen. */
  curves(place, panels) {
    const [width, height, left, low] = [640, 420, 70, 46];
    const runs = ['peer', 'pt', 'claimed by pt'];
    const chosen = new Set([0, 1, 'courtyard', 'backroom']);
    const colour = i => `hsl(${Math.round(i * 360 / panels.length)} 70% var(--curve))`;
    const points = panels.flatMap(panel => panel.runs.flat());
    const scale = (i, from, to) => {
      const values = points.map(p => Math.log10(p[i]));
      const [least, most] = [Math.floor(Math.min(...values)), Math.ceil(Math.max(...values))];
      const at = v => from + (to - from) * (Math.log10(v) - least) / (most - least);
      at.powers = Array.from({ length: most - least + 1 }, (_, k) => 10 ** (least + k));
      return at;
    };
    const x = scale(0, left, width - 10), y = scale(1, height - low, 10);
    const number = v => String(parseFloat(v.toPrecision(3)));
    const svg = drawn('svg', { viewBox: `0 0 ${width} ${height}`, role: 'img',
      'aria-label': 'The curves that are chosen: error against seconds' });
    const curve = (panel, i, run) => {
      const at = panel.runs[run].map(p => [x(p[0]), y(p[1])]);
      const style = `stroke: ${colour(i)}; fill: ${run === 1 ? colour(i) : 'none'}`;
      return [...run < 2 ? [drawn('polyline', { points: at.join(' '),
        style: `stroke: ${colour(i)}; fill: none`, 'stroke-dasharray': run ? 'none' : '5 4' })] : [],
      ...at.map(([px, py], k) => drawn('path', { style,
        d: run < 2 ? `M${px - 3} ${py}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0`
          : `M${px - 5} ${py - 5}l10 10m-10 0l10 -10` }, drawn('title', {},
        `${panel.title}, ${runs[run]}: ${panel.runs[run][k].map(number).join(' s, error ')}`)))];
    };
    const redraw = () => svg.replaceChildren(
      ...x.powers.flatMap(v => [drawn('path', { class: 'grid', d: `M${x(v)} 10V${height - low}` }),
        drawn('text', { x: x(v), y: height - 26, 'text-anchor': 'middle' }, number(v))]),
      ...y.powers.flatMap(v => [drawn('path', { class: 'grid', d: `M${left} ${y(v)}H${width - 10}` }),
        drawn('text', { x: left - 6, y: y(v) + 4, 'text-anchor': 'end' }, number(v))]),
      drawn('text', { x: width / 2, y: height - 4, 'text-anchor': 'middle' }, 'seconds'),
      drawn('text', { x: 12, y: height / 2, 'text-anchor': 'middle',
        transform: `rotate(-90 12 ${height / 2})` }, 'error'),
      ...panels.flatMap((panel, i) => chosen.has(panel.title)
        ? runs.flatMap((_, run) => chosen.has(run) ? curve(panel, i, run) : []) : []));
    const choose = (key, label, style) => checkbox(label, chosen.has(key), on => {
      if (on) chosen.add(key); else chosen.delete(key);
      redraw();
    }, style);
    place.append(
      element('fieldset', {}, element('legend', {}, 'Scenes'), ...panels.map((panel, i) =>
        choose(panel.title, panel.title, `border-bottom: 3px solid ${colour(i)}`))),
      element('fieldset', {}, element('legend', {}, 'Runs'), ...runs.map((run, i) =>
        choose(i, ['○ peer', '● pt', '× claimed by pt'][i]))), svg);
    redraw();
  },

  /* The images of both methods with a number of samples, and their errors. */
  samples(place, counts) {
    const said = element('output', {});
    const methods = { reference: 'paths', gather: 'gather' };
    const views = Object.keys(methods).map(method => {
      const img = element('img', {}), caption = element('figcaption', {});
      return { method, img, caption, box: element('figure', {}, img, caption) };
    });
    const slider = element('input', { type: 'range', min: 0, max: counts.length - 1, value: 0,
      oninput() {
        const [count, errors] = counts[slider.value];
        said.textContent = `${count} sample${count > 1 ? 's' : ''} of a pixel`;
        slider.ariaValueText = said.textContent;
        for (const { method, img, caption } of views) {
          img.src = `figures/samples-${method}-${count}.png`;
          img.alt = `The courtyard by ${methods[method]}, ${said.textContent}`;
          caption.textContent = methods[method]
            + (errors[method] ? `: states an error of ${errors[method]}` : '');
        }
      } });
    place.append(element('label', {}, 'Samples ', slider, ' ', said),
      element('div', { className: 'views' }, ...views.map(view => view.box)));
    slider.oninput();
  },
};

for (const place of document.querySelectorAll('.play'))
  plays[place.dataset.play](place, JSON.parse(place.dataset.data));
