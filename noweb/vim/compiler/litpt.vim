" Copyright (C) 2026 litpt contributors
"
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any
" warranty.
" SPDX-License-Identifier: FSFAP
"
" How the five files work together is said in noweb/chapters/vim.nw.

if exists('current_compiler')
  finish
endif
let current_compiler = 'litpt'

" Run make where the project is
let s:root = noweb#Root()
execute 'CompilerSet makeprg=' . escape(empty(s:root) ? 'make'
      \ : 'make -C ' . shellescape(s:root, 1), ' \|"')
CompilerSet errorformat=%D%*\\a:\ Entering\ directory\ '%f'
CompilerSet errorformat+=%D%*\\a[%*\\d]:\ Entering\ directory\ '%f'

" Understand the messages of rustc
CompilerSet errorformat+=%Eerror[E%n]:\ %m
CompilerSet errorformat+=%Eerror:\ %m
CompilerSet errorformat+=%Wwarning:\ %m
CompilerSet errorformat+=%Inote:\ %m
CompilerSet errorformat+=%Z\ %#-->\ %f:%l:%c

" Understand panics and backtraces
CompilerSet errorformat+=%Ethread\ %.%#\ panicked\ at\ %f:%l:%c:
CompilerSet errorformat+=%*[\ ]at\ %\\%%(%\\f%#chapters/%\\)%\\@=%f:%l:%c
CompilerSet errorformat+=%WDiff\ in\ %f:%l:%.%#
CompilerSet errorformat+=%Z%m

" Understand messages with a place in front
CompilerSet errorformat+=%f:%l:%c:\ %trror:\ %m
CompilerSet errorformat+=%f:%l:%c:\ %tarning:\ %m
CompilerSet errorformat+=%f:%l:\ %tarning:\ %m
CompilerSet errorformat+=%f:%l:\ %m

" Keep what has a place after each run
augroup litpt
  autocmd!
  autocmd QuickFixCmdPost make call noweb#KeepPlaces()
augroup END
