" Copyright (C) 2026 litpt contributors
"
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any
" warranty.
" SPDX-License-Identifier: FSFAP
"
" How the five files work together is said in noweb/chapters/vim.nw.

" Know a definition, a use and prose
let s:head = '^<<\zs.*\ze>>=\s*$'
let s:prose = '^@\%(\s\|$\)'
let s:use = '@\@1<!<<\zs\%(\[\[.\{-}\]\]\|.\)\{-}\ze>>'

" Find the files of the web
function! noweb#Master() abort
  let above = escape(expand('%:p:h'), ' ,') . ';'
  let masters = map(['litpt.nw', 'book.nw', 'SUMMARY.md'],
        \ {_, name -> findfile(name, above)})
  let masters = map(filter(masters, '!empty(v:val)'),
        \ {_, path -> fnamemodify(path, ':p')})
  return get(sort(masters, {a, b -> count(b, '/') - count(a, '/')}), 0, '')
endfunction

function! noweb#Root() abort
  let up = noweb#IsSummary() ? ':h:h' : ':h'
  return empty(noweb#Master()) ? '' : fnamemodify(noweb#Master(), up)
endfunction

function! noweb#IsSummary() abort
  return noweb#Master() =~# 'SUMMARY\.md$'
endfunction

" Tell the language of the prose
function! noweb#Prose() abort
  return expand('%:e') ==# 'md' ? 'markdown' : get(g:, 'noweb_backend', 'tex')
endfunction

function! noweb#Files() abort
  let here = expand('%:p')
  let master = noweb#Master()
  if empty(master)
    return [here]
  endif
  let tool = noweb#Root() . '/noweb/'
  if stridx(here, tool) == 0
    let master = tool . 'noweb.nw'
  endif
  let [include, folder, ending] = noweb#IsSummary()
        \ ? ['](\zs[^)]*', '/', ''] : ['^\\include{\zs[^}]*', '/chapters/', '.nw']
  let names = map(copy(s:Lines(master)),
        \ {_, line -> matchstr(line, include)})
  let beside = fnamemodify(master, ':h') . folder
  let files = [master] + map(filter(names, '!empty(v:val)'),
        \ {_, name -> beside . name . ending})
  return index(files, here) < 0 ? files + [here] : files
endfunction

" Read a file as it stands
function! s:Lines(path) abort
  if bufloaded(a:path)
    return getbufline(bufnr(a:path), 1, '$')
  endif
  return filereadable(a:path) ? readfile(a:path) : []
endfunction

function! s:Stamp(path) abort
  return bufloaded(a:path)
        \ ? [bufnr(a:path), getbufvar(bufnr(a:path), 'changedtick')]
        \ : [0, getftime(a:path)]
endfunction

" Collect the places of a file
let s:known = {}

function! s:Know(path) abort
  let stamp = s:Stamp(a:path)
  if get(s:known, a:path, {'stamp': []}).stamp != stamp
    let lines = s:Lines(a:path)
    let s:known[a:path] = extend(s:Scan(a:path, lines), {'stamp': stamp})
  endif
  return s:known[a:path]
endfunction

" Find the lines that matter
function! s:Matter(lines) abort
  let found = []
  for pattern in ['^@', '<<']
    let index = match(a:lines, pattern)
    while index >= 0
      call add(found, index)
      let index = match(a:lines, pattern, index + 1)
    endwhile
  endfor
  return uniq(sort(found, 'n'))
endfunction

" Go through the lines that matter
function! s:Scan(path, lines) abort
  let known = {'places': [], 'users': {}}
  let [inside, head] = ['', 0]
  for index in s:Matter(a:lines)
    let line = a:lines[index]
    if line[0] ==# '<' && line =~# s:head
      let [inside, head] = [matchstr(line, s:head), index + 1]
      call add(known.places, {'filename': a:path, 'lnum': head, 'col': 1,
            \ 'name': inside, 'role': 'definition'})
    elseif line[0] ==# '@' && line =~# s:prose
      for name in line =~# '^@ %def ' ? split(line)[2:] : []
        call add(known.places, {'filename': a:path, 'lnum': head, 'col': 1,
              \ 'name': name, 'role': 'identifier'})
      endfor
      let inside = ''
    elseif !empty(inside)
      call s:AddUses(known, a:path, index + 1, line, inside)
    endif
  endfor
  return known
endfunction

" Add the uses on a line of code
function! s:AddUses(known, path, number, line, inside) abort
  let [name, from, to] = matchstrpos(a:line, s:use)
  while from >= 0
    call add(a:known.places, {'filename': a:path, 'lnum': a:number,
          \ 'col': from + 1, 'name': name, 'role': 'use',
          \ 'inside': a:inside})
    call extend(a:known.users, {name: a:inside}, 'keep')
    let [name, from, to] = matchstrpos(a:line, s:use, to + 2)
  endwhile
endfunction

" Collect the places of the whole web
function! noweb#Places() abort
  let places = []
  for path in noweb#Files()
    call extend(places, s:Know(path).places)
  endfor
  return places
endfunction

" The definitions and uses of one chunk.
function! s:PlacesNamed(name) abort
  let found = filter(copy(noweb#Places()),
        \ {_, place -> place.name ==# a:name && place.role !=# 'identifier'})
  let seen = 0
  for place in found
    let place.text = place.role ==# 'use' ? 'used in ' . place.inside
          \ : seen ? 'continued' : 'defined'
    let seen = seen || place.role ==# 'definition'
  endfor
  return found
endfunction

" Tell the language of each chunk
function! noweb#Languages(usual) abort
  let [users, answer] = [{}, {}]
  for path in noweb#Files()
    call extend(users, s:Know(path).users, 'keep')
  endfor
  for place in s:Know(expand('%:p')).places
    let [root, steps] = [place.name, 0]
    while has_key(users, root) && steps < 100
      let [root, steps] = [users[root], steps + 1]
    endwhile
    let own = s:LanguageOf(root, a:usual)
    if place.role ==# 'definition' && own !=# a:usual
      let answer[own] = uniq(sort(get(answer, own, []) + [place.name]))
    endif
  endfor
  return answer
endfunction

" Tell the language of a file name
let s:languages = {'rs': 'rust', 'py': 'python', 'mk': 'make',
      \ 'h': 'c', 'md': 'markdown', 'sty': 'tex', 'Makefile': 'make'}

function! s:LanguageOf(path, usual) abort
  let extension = fnamemodify(a:path, ':e')
  let key = empty(extension) ? fnamemodify(a:path, ':t') : extension
  if !has_key(s:languages, key)
    let syntax = globpath(&runtimepath, 'syntax/' . extension . '.vim')
    let s:languages[key] = empty(syntax) ? '' : extension
  endif
  return empty(s:languages[key]) ? a:usual : s:languages[key]
endfunction

" Find what stands under the cursor
function! s:NameUnderCursor() abort
  let [line, column, end] = [getline('.'), col('.'), 0]
  while 1
    let [name, from, end] = matchstrpos(line, s:use, end)
    if from < 0 || from - 1 > column
      return ''
    elseif column <= end + 2
      return name
    endif
    let end += 2
  endwhile
endfunction

" Find items of Rust that are declared in code
let s:item = '^\s*\%(pub\%((\w\+)\)\? \|const \|unsafe \|async \|'
      \ . 'extern "C" \)*\%(fn\|struct\|enum\|union\|trait\|type\|mod\|const\|'
      \ . 'static\|macro_rules!\) \%(mut \)\?'

function! s:Items(name) abort
  let found = []
  let item = a:name =~# '^\h\w*$' ? s:item . a:name . '\s*[(<:={;]'
        \ : '$^x'
  for path in noweb#Files()
    let lines = s:Lines(path)
    let index = match(lines, item)
    while index >= 0
      call add(found, {'filename': path, 'lnum': index + 1, 'name': a:name,
            \ 'role': 'item'})
      let index = match(lines, item, index + 1)
    endwhile
  endfor
  return found
endfunction

" Answer questions for tags
function! noweb#Tags(pattern, flags, info) abort
  let name = a:flags =~# 'c' ? s:NameUnderCursor()
        \ : get(a:info, 'user_data', '')
  let roles = empty(name) ? 'definition\|identifier' : 'definition'
  let name = empty(name) ? a:pattern : name
  let found = filter(copy(noweb#Places()), a:flags =~# 'r'
        \ ? {_, place -> place.role =~# roles && place.name =~ name}
        \ : {_, place -> place.role =~# roles && place.name ==# name})
  if empty(found) && a:flags !~# 'r'
    let found = s:Items(name)
  endif
  return empty(found) ? v:null : map(found, {_, place -> {
        \ 'name': place.name, 'user_data': place.name,
        \ 'filename': place.filename, 'cmd': string(place.lnum),
        \ 'kind': place.role[0]}})
endfunction

" List the places of a chunk
function! noweb#List(name) abort
  let name = empty(a:name) ? s:NameUnderCursor() : a:name
  let found = s:PlacesNamed(name)
  if empty(found)
    echohl ErrorMsg
    echomsg empty(name) ? 'No name of a chunk under the cursor'
          \ : 'No chunk is called ' . name
    echohl None
    return
  endif
  call setloclist(0, [], ' ', {'title': name, 'items': found})
  lopen
endfunction

function! noweb#Names(start, line, position) abort
  let names = map(filter(copy(noweb#Places()), 'v:val.role !=# "identifier"'),
        \ 'v:val.name')
  return filter(uniq(sort(names)), {_, name -> stridx(name, a:start) == 0})
endfunction

" Complete the name of a chunk
function! noweb#Complete(findstart, base) abort
  if a:findstart
    let before = strpart(getline('.'), 0, col('.') - 1)
    let start = match(before, '^.*@\@1<!<<\zs')
    return start < 0 || stridx(before, '>>', start) >= 0 ? -3 : start
  endif
  let rest = strpart(getline('.'), col('.') - 1)
  let close = rest =~# '^>>' ? '' : '>>'
  let names = noweb#Names('', '', 0)
  let first = filter(copy(names), {_, name -> stridx(name, a:base) == 0})
  let others = filter(names, {_, name -> stridx(name, a:base) > 0})
  return map(first + others,
        \ {_, name -> {'word': name . close, 'abbr': name}})
endfunction

" Move from chunk to chunk
function! noweb#Move(flags) abort
  for step in range(v:count1)
    if !search(s:head, a:flags . (step ? '' : 's'))
      break
    endif
  endfor
endfunction

" Fold chunks
function! noweb#Fold(number) abort
  let line = getline(a:number)
  return line =~# s:head ? '>1' : line =~# s:prose ? '0' : '='
endfunction

function! noweb#FoldText() abort
  let size = v:foldend - v:foldstart
  return trim(getline(v:foldstart)) . ' ' . size
        \ . (size == 1 ? ' line ' : ' lines ')
endfunction

" Keep the errors that have a place
function! noweb#KeepPlaces() abort
  let compiler = get(b:, 'current_compiler', get(g:, 'current_compiler', ''))
  let places = filter(getqflist(),
        \ {_, entry -> entry.valid && entry.bufnr
        \ && filereadable(fnamemodify(bufname(entry.bufnr), ':p'))})
  if compiler ==# 'litpt' && !empty(places)
    call setqflist([], 'r', {'items': places})
  endif
endfunction
