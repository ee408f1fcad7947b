/* web.js -- search and previews, for the books on the web
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
