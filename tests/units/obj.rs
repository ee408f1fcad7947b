//! What no file of sensible size can test.

use super::{MOST, countable};

#[test]
fn more_than_can_be_numbered_is_refused() {
    let most = MOST as usize;
    assert_eq!(countable(most, "triangles", MOST), Ok(()));
    let error = countable(most + 1, "triangles", MOST).unwrap_err();
    let words = ": 1073741825 triangles, of which only 1073741824 \
                 can be numbered";
    assert_eq!(error, words);
}
