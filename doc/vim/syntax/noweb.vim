" Licensed under the GNU all-permissive notice (vim)
" Copyright (C) 2026 litpt contributors
"
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any
" warranty.
" SPDX-License-Identifier: FSFAP
if exists('b:current_syntax')
  finish
endif

" Load the syntax of the prose
execute 'runtime! syntax/' . get(g:, 'noweb_backend', 'tex') . '.vim'
unlet! b:current_syntax

" Paint chunks in one language
syntax cluster nowebAnyCode contains=nowebUse
syntax cluster texFoldGroup add=nowebChunk,nowebQuote
function! s:PaintChunks(language, names) abort
  let cluster = '@nowebCode_' . a:language
  execute 'syntax include' cluster 'syntax/' . a:language . '.vim'
  unlet! b:current_syntax
  execute 'syntax cluster nowebAnyCode add=' . cluster
  execute 'syntax region nowebChunk matchgroup=nowebDefinition'
        \ 'start=/^<<' . a:names . '>>=\s*$/'
        \ 'end=/^@\ze\%(\s\|$\)/ end=/^\ze<<.*>>=\s*$/'
        \ 'keepend contains=nowebUse,' . cluster
        \ 'containedin=@texMathZones'
endfunction

" Paint each chunk in its language
let s:language = get(g:, 'noweb_language', 'rust')
call s:PaintChunks(s:language, '.*')
let b:noweb_languages = noweb#Languages(s:language)
for [s:other, s:names] in items(b:noweb_languages)
  call s:PaintChunks(s:other, '\%(\V' . join(map(copy(s:names),
        \ {_, name -> escape(name, '\/')}), '\|') . '\m\)')
endfor
syntax sync fromstart

" Paint quoted code and uses
execute 'syntax region nowebQuote matchgroup=nowebBracket'
      \ 'start=/@\@1<!\[\[/ end=/\]\]\]\@!/ keepend'
      \ 'contains=nowebUse,@nowebCode_' . s:language
      \ 'containedin=@texFoldGroup,@texMatchGroup,@texCmdGroup'
syntax match nowebUse /@\@1<!<<.\{-}>>/
      \ contained containedin=@nowebAnyCode
syntax match nowebEscape /@<<\|@>>\|^@@/
      \ contained containedin=@nowebAnyCode

" Choose colours by their meaning
highlight default link nowebDefinition Identifier
highlight default link nowebUse Identifier
highlight default link nowebBracket Delimiter
highlight default link nowebEscape SpecialChar

let b:current_syntax = 'noweb'
