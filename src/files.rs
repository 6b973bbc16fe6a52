//! Files that others have made: read within a limit, and only from where they belong.

use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

/// No list, calibration, settings file or record comes near this size.
pub(crate) const MAX_TEXT_BYTES: u64 = 64 << 20;

/// The whole of a regular file. Anything else is refused before it is opened: a pipe would wait for ever.
/// Of a file that grows, or a device without a length, no more than `limit` bytes are taken.
pub(crate) fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let meta = std::fs::metadata(path)?;
    if !meta.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file"));
    }
    if meta.len() > limit {
        return Err(too_long(limit));
    }
    read_stream(path, meta.len(), limit)
}

/// As [`read`], of UTF-8 text; a byte order mark is dropped.
pub(crate) fn read_text(path: &Path) -> io::Result<String> {
    text(read(path, MAX_TEXT_BYTES)?)
}

/// As [`read_text`], of a file that the user named: it may be a pipe, such as a shell's `<(command)`.
pub(crate) fn read_given_text(path: &Path) -> io::Result<String> {
    text(read_stream(path, 0, MAX_TEXT_BYTES)?)
}

fn read_stream(path: &Path, expected: u64, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(expected as usize);
    std::fs::File::open(path)?.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_long(limit)) } else { Ok(bytes) }
}

fn too_long(limit: u64) -> io::Error {
    io::Error::new(io::ErrorKind::FileTooLarge, format!("longer than the limit of {limit} bytes"))
}

fn text(bytes: Vec<u8>) -> io::Result<String> {
    let text = String::from_utf8(bytes).map_err(|e| {
        io::Error::new(io::ErrorKind::InvalidData, format!("not text: {}", e.utf8_error()))
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// `listed` inside `folder`. Refuses absolute names and `..`: what a file names must not reach outside the
/// folder that it came in.
pub(crate) fn inside(folder: &Path, listed: &str) -> Result<PathBuf, String> {
    let relative = Path::new(listed);
    let stays =
        relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    // Drive letters and backslashes mean nothing here, but a list may come from another system.
    if listed.is_empty() || !stays || listed.contains(['\\', '\0']) || listed.get(1..2) == Some(":")
    {
        return Err(format!("\"{listed}\" points outside its folder"));
    }
    Ok(folder.join(relative))
}

/// A link may lead out of the folder although its name does not. A file that is not there leads nowhere.
pub(crate) fn leads_out(folder: &Path, path: &Path) -> bool {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    match (folder.canonicalize(), path.canonicalize()) {
        (Ok(folder), Ok(path)) => !path.starts_with(folder),
        (_, there) => there.is_ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn files_are_read_up_to_their_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "\u{feff}four").unwrap();
        assert_eq!(read(&path, 7).unwrap().len(), 7);
        assert_eq!(read(&path, 6).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(read_text(&path).unwrap(), "four");
        assert_eq!(read_given_text(&path).unwrap(), "four");
        assert!(read(folder.path(), 9).unwrap_err().to_string().contains("not a regular file"));
        std::fs::write(&path, [0xff]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("not text"));
    }

    #[cfg(unix)]
    #[test]
    fn devices_without_an_end_are_refused_or_cut() {
        assert!(read(Path::new("/dev/zero"), 9).is_err());
        let endless = read_stream(Path::new("/dev/zero"), 0, 9).unwrap_err();
        assert_eq!(endless.kind(), io::ErrorKind::FileTooLarge);
    }

    #[cfg(unix)]
    #[test]
    fn links_that_lead_out_are_found() {
        use std::os::unix::fs::symlink;
        let root = tempfile::tempdir().unwrap();
        let (inner, outer) = (root.path().join("in"), root.path().join("out"));
        for folder in [&inner, &outer] {
            std::fs::create_dir(folder).unwrap();
            std::fs::write(folder.join("a"), "x").unwrap();
        }
        symlink(&outer, inner.join("folder")).unwrap();
        symlink("../out/a", inner.join("file")).unwrap();
        symlink("a", inner.join("own")).unwrap();
        symlink("nothing", inner.join("dangling")).unwrap();
        symlink(&inner, root.path().join("alias")).unwrap();
        for (name, out) in
            [("a", false), ("own", false), ("dangling", false), ("file", true), ("folder/a", true)]
        {
            assert_eq!(leads_out(&inner, &inner.join(name)), out, "{name}");
            let alias = root.path().join("alias");
            assert_eq!(leads_out(&alias, &alias.join(name)), out, "alias/{name}");
        }
    }
}
