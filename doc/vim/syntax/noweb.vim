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
let s:code = get(g:, 'noweb_language', 'rust')
let s:prose = get(g:, 'noweb_backend', 'tex')
let s:fold = get(g:, 'noweb_fold_code', 0)

" Load the syntax of prose and code
execute 'runtime! syntax/' . s:prose . '.vim'
unlet! b:current_syntax
execute 'syntax include @nowebCode syntax/' . s:code . '.vim'
unlet! b:current_syntax
" Paint the chunks as code
execute 'syntax region nowebChunk matchgroup=nowebDefinition'
      \ 'start=/^<<.*>>=\s*$/'
      \ 'end=/^@\ze\%(\s\|$\)/ end=/^\ze<<.*>>=\s*$/'
      \ 'keepend contains=@nowebCode,nowebUse'
      \ 'containedin=@texFoldGroup,@texMathZones'
      \ s:fold ? 'fold' : ''
if s:fold
  setlocal foldmethod=syntax
endif
syntax sync fromstart
" Paint quoted code and uses
syntax region nowebQuote matchgroup=nowebBracket
      \ start=/@\@1<!\[\[/ end=/\]\]\]\@!/ keepend
      \ contains=@nowebCode,nowebUse
      \ containedin=@texFoldGroup,@texMatchGroup,@texCmdGroup
syntax match nowebUse /@\@1<!<<.\{-}>>/
      \ contained containedin=@nowebCode
syntax match nowebEscape /@<<\|@>>\|^@@/
      \ contained containedin=@nowebCode
" Choose colours by their meaning
highlight default link nowebDefinition Identifier
highlight default link nowebUse Identifier
highlight default link nowebBracket Delimiter
highlight default link nowebEscape SpecialChar
let b:current_syntax = 'noweb'
