" Licensed under the GNU all-permissive notice (vim)
" Copyright (C) 2026 litpt contributors
"
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any
" warranty.
" SPDX-License-Identifier: FSFAP
function! ListRoots() abort
  let [seen, roots] = [{}, []]
  for place in noweb#Places()
    let seen[place.name] = place.role ==# 'use' || has_key(seen, place.name)
          \ && seen[place.name]
  endfor
  for place in noweb#Places()
    if place.role ==# 'definition' && !seen[place.name]
      call add(roots, extend({'text': place.name}, place))
      let seen[place.name] = 1
    endif
  endfor
  call setloclist(0, [], ' ', {'title': 'roots', 'items': roots})
  lopen
endfunction
command! Roots call ListRoots()
