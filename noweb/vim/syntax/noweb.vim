" Copyright (C) 2026 litpt contributors
"
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any
" warranty.
" SPDX-License-Identifier: FSFAP
"
" How the five files work together is said in noweb/chapters/vim.nw.

if exists('b:current_syntax')
  finish
endif

" Load the syntax of the prose
execute 'runtime! syntax/' . noweb#Prose() . '.vim'
unlet! b:current_syntax
syntax cluster nowebInProse contains=nowebQuote,nowebEscape
for s:group in ['Fold', 'Match', 'Style', 'Bold', 'Ital', 'Cmd', 'MathZone']
  execute 'syntax cluster tex' . s:group . 'Group add=@nowebInProse'
endfor

" Paint chunks in one language
let s:starts = []
syntax cluster nowebAnyCode contains=nowebUse

function! s:PaintChunks(language, names) abort
  let [code, chunk] = ['nowebCode_' . a:language, 'nowebChunk_' . a:language]
  execute 'syntax include @' . code 'syntax/' . a:language . '.vim'
  unlet! b:current_syntax
  execute 'syntax cluster nowebAnyCode add=@' . code
  execute 'syntax cluster nowebInProse add=' . chunk
  let start = '/^<<' . a:names . '>>=\s*$/'
  call add(s:starts, chunk . ' ' . start)
  execute 'syntax region' chunk 'matchgroup=nowebDefinition'
        \ 'start=' . start
        \ 'end=/^@\ze\%(\s\|$\)/ end=/^\ze<<.*>>=\s*$/'
        \ 'keepend contains=nowebUse,@' . code
endfunction

" Paint each chunk in its language
let s:language = get(g:, 'noweb_language', 'rust')
let b:noweb_languages = noweb#Languages(s:language)
call s:PaintChunks(s:language, '.*')
for [s:other, s:names] in items(b:noweb_languages)
  call s:PaintChunks(s:other, '\%(\V' . join(map(copy(s:names),
        \ {_, name -> escape(name, '\/')}), '\|') . '\m\)')
endfor

" Begin to paint at an end of a chunk
syntax sync clear
syntax sync match nowebSync grouphere NONE /^@\%(\s\|$\)/
for s:start in s:starts
  execute 'syntax sync match nowebSync grouphere' s:start
endfor
syntax sync maxlines=1000

" Paint quoted code and uses
if noweb#Prose() !=# 'markdown'
  execute 'syntax region nowebQuote matchgroup=nowebBracket'
        \ 'start=/@\@1<!\[\[/ end=/\]\]\]\@!/ keepend'
        \ 'contains=nowebUse,@nowebCode_' . s:language
endif
syntax match nowebUse /@\@1<!<<.\{-}>>/
      \ contained containedin=@nowebAnyCode
syntax match nowebEscape /@<<\|@>>\|@\[\[\|@\]\]\|^@@/
      \ containedin=@nowebAnyCode

" Choose colours by their meaning
highlight default link nowebDefinition Identifier
highlight default link nowebUse Identifier
highlight default link nowebBracket Delimiter
highlight default link nowebEscape SpecialChar

let b:current_syntax = 'noweb'
