# config.mk -- what a user may want to change. The Makefile reads it.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.

# Where the program, the book and the pictures go.
BUILD_DIR = build

# Fast: optimised, and soon compiled again after a change. Release: longer to
# compile, and 1.1 to 1.3 times as many rays a second, for long renders. Debug:
# with all checks, much slower, for looking for errors.
BUILD_TYPE = Fast

# Options of notangle, which "make chunk" calls; for instance
# -L'// %F:%L%N' to see where the lines come from. The program itself is
# tangled by build.rs, with fixed options, because its text is committed.
NOTANGLE_OPTS =

# Options of noweave: index the identifiers, those of Rust by itself; begin
# with the author's own first line instead of a preamble; print the commands of
# the pipeline.
NOWEAVE_OPTS = -index -autodefs rust -delay -v

# The Rust package manager, and where it keeps what it compiles. It fetches and
# builds the libraries by itself: there is no path to installed libraries.
CARGO = cargo
CARGO_TARGET_DIR ?= target
