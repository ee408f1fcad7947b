//! What no file of sensible size can test.

use super::{MOST, countable};

#[test]
fn more_than_can_be_numbered_is_refused() {
    assert!(countable(MOST).is_ok());
    let error = countable(MOST + 1).unwrap_err().to_string();
    let words = "1073741825 vertices or triangles, of which only \
                 1073741824 can be numbered";
    assert_eq!(error, words);
}
