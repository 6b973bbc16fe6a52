//! Text files of recordings: lists, trajectories, matrices.

use super::CaptureError;
use crate::files;
use std::path::Path;

/// The whole file, without byte order mark. Refuses what is no regular file, too long, or not UTF-8.
pub(super) fn read(path: &Path) -> Result<String, CaptureError> {
    files::read_text(path).map_err(|e| CaptureError::io(path, e))
}

/// Lines with their number from 1; comments (`#`) and blank lines left out, line ends trimmed.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// The numbers of a line. NaN and infinities parse; who reads them judges them.
pub(super) fn numbers(line: &str) -> Result<Vec<f64>, String> {
    line.split(|c: char| c.is_whitespace() || c == ',')
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().map_err(|_| format!("\"{word}\" is not a number")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_blank_lines_and_line_ends_go() {
        let found: Vec<_> = lines("# head\r\n\r\n 1 a \r\n#x\n2 b\n").collect();
        assert_eq!(found, [(3, "1 a"), (5, "2 b")]);
    }
}
