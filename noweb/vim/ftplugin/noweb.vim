" Copyright (C) 2026 litpt contributors
"
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any
" warranty.
" SPDX-License-Identifier: FSFAP
"
" How the five files work together is said in noweb/chapters/vim.nw.

if exists('b:did_ftplugin')
  finish
endif
execute 'runtime! ftplugin/' . noweb#Prose() . '.vim'
let b:did_ftplugin = 1
let b:undo_ftplugin = get(b:, 'undo_ftplugin', 'execute')

" Look names up in the web
setlocal tagfunc=noweb#Tags omnifunc=noweb#Complete
command! -buffer -nargs=? -complete=customlist,noweb#Names Chunk
      \ call noweb#List(<q-args>)
let b:undo_ftplugin .= ' | setlocal tagfunc< omnifunc<'
      \ . ' | delcommand -buffer Chunk'

" Find files from anywhere
let s:root = escape(noweb#Root(), ' ,\')
if !empty(s:root)
  let &l:path = join(['.', s:root, s:root . '/chapters', ''], ',') . ','
endif
setlocal suffixesadd=.nw
let b:undo_ftplugin .= ' | setlocal path< suffixesadd<'

" Pair the ends of a chunk
let s:words = get(b:, 'match_words', '')
let b:match_words = s:words . (empty(s:words) ? '' : ',')
      \ . '^<<.*>>=\s*$:^@\%(\s\|$\)'
let b:undo_ftplugin .= ' | unlet! b:match_words'

" Map the keys for chunks
if !exists('g:no_plugin_maps')
  noremap <buffer> ]] <Cmd>call noweb#Move('W')<CR>
  noremap <buffer> [[ <Cmd>call noweb#Move('bW')<CR>
  let b:undo_ftplugin .= ' | execute "unmap <buffer> ]]"'
        \ . ' | execute "unmap <buffer> [["'
endif

" Fold chunks if asked to
if get(g:, 'noweb_fold_code', 0)
  setlocal foldmethod=expr foldexpr=noweb#Fold(v:lnum)
  setlocal foldtext=noweb#FoldText()
  let b:undo_ftplugin .= ' | setlocal foldmethod< foldexpr< foldtext<'
endif

" Paint anew when a language changes
augroup noweb
  autocmd! BufWritePost <buffer>
  autocmd BufWritePost <buffer> if exists('b:noweb_languages') &&
        \ b:noweb_languages !=# noweb#Languages(
        \ get(g:, 'noweb_language', 'rust')) | set syntax=noweb | endif
augroup END
let b:undo_ftplugin .= ' | autocmd! noweb BufWritePost <buffer>'
