" Copyright (C) 2026 litpt contributors
"
" Copying and distribution of this file, with or without modification, are
" permitted in any medium without royalty provided the copyright notice and
" this notice are preserved. This file is offered as-is, without any
" warranty.
" SPDX-License-Identifier: FSFAP
autocmd BufRead,BufNewFile *.nw set filetype=noweb
autocmd BufRead *.md if search('^<<.*>>=\s*$', 'nw') | set filetype=noweb | endif
