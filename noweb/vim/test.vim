" test.vim -- tags, lists, completion, folds, keys and errors in a small web
"
" Run by test.sh, in the web that it makes. Writes "ok" or what failed to the
" file "result".
"
" Copyright (C) 2026 litpt contributors
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any warranty.
set nocompatible hidden
packadd! matchit
filetype plugin on
syntax on
runtime plugin/matchit.vim

" The group at a text of a line, and the file, line and column of the cursor.
function! Group(line, text) abort
  return synIDattr(synID(a:line, stridx(getline(a:line), a:text) + 1, 1), 'name')
endfunction

function! Here() abort
  return expand('%:t') . ':' . line('.') . ':' . col('.')
endfunction

function! On(line, text) abort
  call cursor(a:line, stridx(getline(a:line), a:text) + 1)
endfunction

function! Test_a_chapter_has_the_filetype() abort
  edit chapters/one.nw
  call assert_equal('noweb', &filetype)
  call assert_equal('noweb', &syntax)
  call assert_equal('noweb#Tags', &tagfunc)
  call assert_match('nofoldenable\|manual', &foldmethod . execute('set fen?'))
endfunction

function! Test_a_chunk_has_the_language_of_its_root() abort
  edit chapters/one.nw
  call assert_equal({'sh': ['Ask the shell'], 'make': ['Makefile']},
        \ b:noweb_languages)
  call assert_equal('rustKeyword', Group(5, 'fn'))
  call assert_equal('shConditional', Group(11, 'if'))
  call assert_equal('nowebUse', Group(11, '<<Say'))
  call assert_equal('makeTarget', Group(14, 'all'))
  edit chapters/three.nw
  call assert_equal({'sh': ['Say so']}, b:noweb_languages)
  call assert_equal('rustDecNumber', Group(3, '1'))
  call assert_match('sh', Group(9, 'sed'))
endfunction

function! Test_code_is_painted_after_a_brace_that_is_left_open() abort
  edit chapters/three.nw
  call append(1, ['\texttt{@[[} \emph{left open and $x', 'more'])
  call assert_equal('rustDecNumber', Group(5, '1'))
  call assert_equal('nowebEscape', Group(2, '@[['))
  edit!
endfunction

function! Test_painting_begins_at_the_last_chunk() abort
  edit chapters/three.nw
  call append('$', ['\begin{verbatim}', '<<Fill it>>=', 'y += 3;', '@'])
  call assert_equal('rustDecNumber', Group(line('$') - 1, '3'))
  edit!
endfunction

function! Test_a_new_root_changes_the_language() abort
  edit chapters/three.nw
  call append('$', ['<<x.vim>>=', '<<Fill it too>>', '@',
        \ '<<Fill it too>>=', 'let x = 1', '@'])
  call assert_equal('rustKeyword', Group(line('$') - 1, 'let'))
  write
  call assert_equal('vimLet', Group(line('$') - 1, 'let'))
  silent undo
  write
  call assert_equal({'sh': ['Say so']}, b:noweb_languages)
endfunction

function! Test_other_variables_give_other_languages() abort
  let [g:noweb_language, g:noweb_backend] = ['c', 'html']
  edit +set\ filetype=noweb chapters/two.nw
  call assert_equal('cType', b:noweb_languages == {} ? '' : Check_c())
  unlet g:noweb_language g:noweb_backend
  set filetype=noweb
endfunction

function! Check_c() abort
  new
  call setline(1, ['<b>bold</b>', '<<Alone>>=', 'int x;', '@'])
  set filetype=noweb
  call assert_equal('htmlTagName', Group(1, 'b>'))
  let group = Group(3, 'int')
  bwipeout!
  return group
endfunction

function! Test_a_use_leads_to_its_definition_and_back() abort
  edit chapters/one.nw
  call On(6, 'v[0]')
  execute "normal! \<C-]>"
  call assert_equal('two.nw:2:1', Here())
  tnext
  call assert_equal('three.nw:2:1', Here())
  call assert_equal(2, count(execute('tselect'), 'user_data'))
  edit chapters/two.nw
  call On(3, 'Fill')
  execute "normal! \<C-]>"
  pop
  call assert_equal(2, count(execute('tselect'), 'user_data:Compute'))
  execute "normal! \<C-T>"
  call assert_equal('one.nw:6', expand('%:t') . ':' . line('.'))
endfunction

function! Test_the_second_use_on_a_line_is_found() abort
  edit chapters/one.nw
  call On(11, 'so>>')
  execute "normal! \<C-]>"
  call assert_equal('three.nw:8:1', Here())
  edit chapters/two.nw
  call cursor(3, strridx(getline(3), 'it') + 1)
  execute "normal! \<C-]>"
  call assert_equal('two.nw:5:1', Here())
endfunction

function! Test_an_identifier_leads_to_its_chunk() abort
  edit chapters/two.nw
  call On(3, 'one()')
  execute "normal! \<C-]>"
  call assert_equal('one.nw:3:1', Here())
  edit chapters/two.nw
  call On(3, 'let')
  call assert_fails("normal! \<C-]>", 'E433:')
endfunction

function! Test_an_item_that_is_not_listed_leads_to_its_line() abort
  edit chapters/one.nw
  call append(7, ['    pub(crate) const fn hidden() {}', 'hidden();',
        \ 'fn hidden in prose'])
  call On(9, 'hidden')
  execute "normal! \<C-]>"
  call assert_equal('one.nw:8:5', Here())
  call assert_fails('tag hid', 'E433:')
  edit!
endfunction

function! Test_a_web_in_markdown_is_painted_and_searched() abort
  edit book/two.md
  call assert_equal('noweb', &filetype)
  call assert_equal('markdownH1', Group(1, 'Two'))
  call assert_equal('rustKeyword', Group(4, 'let'))
  call On(5, 'Say')
  execute "normal! \<C-]>"
  call assert_equal('one.md:2:1', Here())
  edit book/SUMMARY.md
  call assert_equal('markdown', &filetype)
endfunction

function! Test_a_tag_can_be_a_pattern() abort
  edit chapters/one.nw
  tag /^Compute
  call assert_equal('two.nw:2:1', Here())
endfunction

function! Test_text_that_is_not_written_counts() abort
  edit chapters/two.nw
  call append(4, ['<<Unwritten>>=', 'let z = 0;', '@'])
  edit chapters/one.nw
  tag Unwritten
  call assert_equal('two.nw:5:1', Here())
  edit! chapters/two.nw
  call assert_fails('tag Unwritten', 'E433:')
endfunction

function! Test_all_places_of_a_chunk_are_listed() abort
  edit chapters/one.nw
  call On(6, 'Compute')
  Chunk
  call assert_equal('quickfix', &buftype)
  call assert_equal([['one.nw', 6, 7, 'used in src/one.rs'],
        \ ['two.nw', 2, 1, 'defined'], ['three.nw', 2, 1, 'continued']],
        \ map(getloclist(0), {_, item -> [fnamemodify(bufname(item.bufnr),
        \ ':t'), item.lnum, item.col, item.text]}))
  lclose
  Chunk Fill it
  lclose
  call assert_equal(4, len(getloclist(0)))
  call assert_equal(['Fill it'], getcompletion('Chunk Fil', 'cmdline'))
  edit chapters/one.nw
  call cursor(1, 1)
  call assert_match('No name', execute('Chunk'))
endfunction

function! Test_names_are_completed() abort
  edit chapters/one.nw
  call append(5, '')
  call cursor(6, 1)
  execute "normal! A    <<Fil\<C-X>\<C-O>"
  call assert_equal('    <<Fill it>>', getline(6))
  execute "normal! ccx <<Ask>>\<Left>\<Left>\<C-X>\<C-O>"
  call assert_equal('x <<Ask the shell>>', getline(6))
  execute "normal! cc<<so\<C-X>\<C-O>"
  call assert_equal('<<Say so>>', getline(6))
  edit!
endfunction

function! Test_gf_opens_files_and_chapters() abort
  cd chapters
  edit one.nw
  call On(3, 'src')
  normal! gf
  call assert_equal('one.rs', expand('%:t'))
  cd ..
  edit litpt.nw
  call On(5, 'three')
  normal! gf
  call assert_equal('three.nw', expand('%:t'))
endfunction

function! Test_keys_go_from_chunk_to_chunk() abort
  edit chapters/one.nw
  call cursor(1, 1)
  normal ]]
  call assert_equal(3, line('.'))
  normal 2]]
  call assert_equal(13, line('.'))
  normal [[
  call assert_equal(10, line('.'))
  execute 'normal ' . "\<C-O>"
  call assert_equal(13, line('.'))
endfunction

function! Test_percent_pairs_the_ends_of_a_chunk() abort
  edit chapters/one.nw
  call cursor(3, 1)
  normal %
  call assert_equal(8, line('.'))
  normal %
  call assert_equal(3, line('.'))
endfunction

function! Test_chunks_are_folded_if_asked_to() abort
  let g:noweb_fold_code = 1
  edit chapters/two.nw
  set filetype=noweb
  set foldenable foldlevel=0
  call assert_equal([-1, 2, 2, -1, 5, 5, -1],
        \ map(range(1, 7), {_, line -> foldclosed(line)}))
  call assert_equal('<<Fill it>>= 1 line ', foldtextresult(5))
  call assert_equal('<<run.sh>>= 2 lines ', foldtextresult(8))
  unlet g:noweb_fold_code
  set filetype=noweb
  call assert_equal('manual', &foldmethod)
endfunction

function! Test_another_type_takes_everything_back() abort
  edit chapters/two.nw
  set filetype=
  call assert_equal(['', '', ''], [&l:tagfunc, &l:omnifunc, maparg(']]')])
  call assert_equal(0, exists(':Chunk'))
  call assert_false(exists('b:match_words'))
  set filetype=noweb
  call assert_equal(2, exists(':Chunk'))
endfunction

" Runs make on a recorded output and returns its entries that have a place.
function! Errors(log) abort
  compiler! litpt
  execute 'silent make! LOG=' . a:log
  return map(filter(getqflist(), 'v:val.valid'), {_, item ->
        \ [fnamemodify(bufname(item.bufnr), ':t') . ':' . item.lnum . ':'
        \ . item.col, item.type, item.text]})
endfunction

function! Test_the_compiler_is_understood_from_any_directory() abort
  edit chapters/three.nw
  edit chapters/one.nw
  cd chapters
  call assert_equal([['two.nw:3:13', 'E', 'mismatched types'],
        \ ['one.nw:5:4', 'I', 'function defined here']],
        \ map(Errors('type.log'),
        \ {_, item -> [item[0], item[1], trim(item[2])]}))
  silent cfirst
  call assert_equal('two.nw:3:13', Here())
  cd ..
endfunction

function! Test_an_error_without_a_place_is_kept_if_it_is_alone() abort
  call assert_match('linking', string(Errors('link.log')))
endfunction

function! Test_a_make_within_make_is_understood() abort
  cd chapters
  let $MAKELEVEL = 1
  call assert_equal('two.nw:3:13', Errors('type.log')[0][0])
  silent cfirst
  call assert_equal('two.nw:3:13', Here())
  unlet $MAKELEVEL
  cd ..
endfunction

function! Test_a_chapter_of_the_tool_belongs_to_its_own_web() abort
  edit noweb/chapters/tool.nw
  call assert_equal(['noweb.nw', 'tool.nw'],
        \ map(noweb#Files(), 'fnamemodify(v:val, ":t")'))
  edit chapters/one.nw
endfunction

function! Test_lints_are_understood() abort
  call assert_equal([['three.nw:3:5', 'W', ' this `if` has identical blocks']],
        \ map(Errors('lint.log'), {_, item -> [item[0], item[1], ' ' . trim(item[2])]}))
endfunction

function! Test_failing_tests_and_backtraces_are_understood() abort
  let found = Errors('test.log')
  call assert_equal(['two.nw:6:1', 'one.nw:5:1', 'tool.nw:2:1'],
        \ map(copy(found), 'v:val[0]'))
  call assert_match('left == right', found[0][2])
  silent cfirst
  call assert_equal('two.nw:6:1', Here())
  silent cnext
  call assert_equal('one.nw:5:1', Here())
endfunction

function! Test_panics_without_a_thread_number_are_understood() abort
  let found = Errors('old-panic.log')
  call assert_equal(['three.nw:9:3'], map(copy(found), 'v:val[0]'))
  call assert_match('index out of bounds', found[0][2])
endfunction

function! Test_the_tool_is_understood() abort
  call assert_equal([['two.nw:3:20', 'e'], ['one.nw:10:3', 'w']],
        \ map(Errors('tool.log'), 'v:val[:1]'))
endfunction

function! Test_LaTeX_is_understood() abort
  call assert_equal([['two.nw:1:0', ''], ['one.nw:2:0', 'w']],
        \ map(Errors('tex.log'), 'v:val[:1]'))
endfunction

function! Test_rustfmt_is_understood() abort
  call assert_equal(['one.nw:6:0'], map(Errors('format.log'), 'v:val[0]'))
endfunction

" Each test begins without any file.
let s:failed = []
for s:test in sort(getcompletion('Test_', 'function'))
  let v:errors = []
  try
    silent! %bwipeout!
    execute 'call ' . s:test . (s:test =~# ')$' ? '' : ')')
  catch
    call add(v:errors, v:throwpoint . ': ' . v:exception)
  endtry
  if !empty(v:errors)
    call add(s:failed, 'error: noweb/vim/test.vim: ' . s:test)
    call extend(s:failed, map(copy(v:errors), '"  " . v:val'))
  endif
endfor
call writefile(empty(s:failed) ? ['ok'] : s:failed, 'result')
quitall!
