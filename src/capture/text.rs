//! Text files of recordings: lists, trajectories, matrices.

use super::CaptureError;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// No list or calibration file of a recording comes near this size.
const MAX_TEXT_BYTES: u64 = 64 << 20;

/// The whole file, without byte order mark. Refuses what is no regular file, too long, or not UTF-8.
pub(super) fn read(path: &Path) -> Result<String, CaptureError> {
    let io = |e| CaptureError::io(path, e);
    if !std::fs::metadata(path).map_err(io)?.is_file() {
        return Err(CaptureError::file(path, "not a regular file"));
    }
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(io)?;
    file.take(MAX_TEXT_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > MAX_TEXT_BYTES {
        return Err(CaptureError::file(path, format!("longer than {MAX_TEXT_BYTES} bytes")));
    }
    let text = String::from_utf8(bytes)
        .map_err(|e| CaptureError::file(path, format!("not text: {}", e.utf8_error())))?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
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

/// `listed` inside `folder`. Refuses absolute names and `..`: a list must not reach outside its
/// recording.
pub(super) fn inside(folder: &Path, listed: &str) -> Result<PathBuf, String> {
    let relative = Path::new(listed);
    let stays =
        relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    // Drive letters and backslashes mean nothing here, but a list may come from another system.
    if listed.is_empty() || !stays || listed.contains(['\\', '\0']) || listed.get(1..2) == Some(":")
    {
        return Err(format!("\"{listed}\" points outside the recording"));
    }
    Ok(folder.join(relative))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_blank_lines_and_line_ends_go() {
        let found: Vec<_> = lines("# head\r\n\r\n 1 a \r\n#x\n2 b\n").collect();
        assert_eq!(found, [(3, "1 a"), (5, "2 b")]);
    }

    #[test]
    fn names_outside_are_refused() {
        let root = Path::new("/data/seq");
        for bad in ["../x.png", "/etc/passwd", "rgb/../../x", "..", "", "C:\\x", "a\\..\\b", "c:x"]
        {
            assert!(inside(root, bad).is_err(), "{bad}");
        }
        assert_eq!(inside(root, "./rgb/1.png").unwrap(), root.join("./rgb/1.png"));
        assert_eq!(inside(root, "rgb/1..png").unwrap(), root.join("rgb/1..png"));
    }
}
