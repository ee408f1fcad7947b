for last; do :; done
printf "@file x\n@begin code 0\n@defn *\n@nl\n@text %s\n@nl\n@end code 0\n" "$(cat "$last")"
