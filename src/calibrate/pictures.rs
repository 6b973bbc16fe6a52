//! Finding and reading the pictures of a calibration.

use super::CalibrateError;
use crate::capture::{CaptureError, MAX_PIXELS, read_color};
use crate::files;
use crate::image::encoded;
use crate::image::{Image, Size};
use std::path::{Path, PathBuf};

/// A picture and what tells it from others of its kind: its name, or the part that `*` stands for.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NamedPicture {
    pub key: String,
    pub path: PathBuf,
}

/// The pictures of a folder, or those that match a pattern with one `*` in the file name
/// (`folder/*-c1.jpg`), in order of name. `extensions` are in lower case.
pub fn find_pictures(
    pattern: &Path,
    extensions: &[&str],
) -> Result<Vec<NamedPicture>, CalibrateError> {
    let file_name = pattern.file_name().map(|n| n.to_string_lossy().into_owned());
    let starred = file_name.filter(|name| name.contains('*'));
    let folder = match (&starred, pattern.parent()) {
        (Some(_), Some(parent)) if parent.as_os_str().is_empty() => Path::new("."),
        (Some(_), Some(parent)) => parent,
        _ => pattern,
    };
    let name = starred.unwrap_or_else(|| "*".into());
    let (before, after) = name.split_once('*').unwrap_or((&name, ""));
    let entries = std::fs::read_dir(folder).map_err(|e| CaptureError::io(folder, e))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| CaptureError::io(folder, e))?.path();
        let Some(name) = path.file_name().map(|n| n.to_string_lossy().into_owned()) else {
            continue;
        };
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let middle = name.strip_prefix(before).and_then(|rest| rest.strip_suffix(after));
        if let (Some(middle), Some(extension)) = (middle, extension)
            && extensions.contains(&extension.as_str())
        {
            let key = middle.strip_suffix(&format!(".{extension}")).unwrap_or(middle).to_owned();
            found.push(NamedPicture { key, path });
        }
    }
    found.sort();
    if found.is_empty() {
        let problem = format!("no pictures ({}) here", extensions.join(", "));
        return Err(CaptureError::file(pattern, problem).into());
    }
    Ok(found)
}

pub const COLOR_EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// 8-bit RGB codes as stored.
pub fn read_picture(path: &Path) -> Result<Image<[u8; 3]>, CalibrateError> {
    Ok(read_color(path)?)
}

/// 8-bit grey: the rounded mean of red, green and blue, which for grey pictures is what they hold.
pub fn grey(picture: &Image<[u8; 3]>) -> Image<u8> {
    let mean = |p: &[u8; 3]| {
        let sum: u16 = p.iter().map(|&v| u16::from(v)).sum();
        ((sum + 1) / 3) as u8
    };
    Image::from_vec(picture.size(), picture.as_slice().iter().map(mean).collect())
}

/// An exposure list: a file name and seconds in each line, `#` starts a comment. The pictures lie in the
/// list's folder or below it.
pub fn read_exposure_list(path: &Path) -> Result<Vec<(PathBuf, f64)>, CalibrateError> {
    let content = files::read_text(path).map_err(|e| CaptureError::io(path, e))?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut found = Vec::new();
    for (i, line) in content.lines().enumerate() {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let parsed = line
            .rsplit_once(char::is_whitespace)
            .and_then(|(name, seconds)| Some((name.trim(), seconds.parse::<f64>().ok()?)));
        let Some((name, seconds)) = parsed else {
            let problem = format!("line {}: expected a file name and seconds", i + 1);
            return Err(CaptureError::file(path, problem).into());
        };
        let picture = files::inside(folder, name)
            .and_then(|picture| match files::leads_out(folder, &picture) {
                true => Err(format!("\"{name}\" is a link that leads out of the list's folder")),
                false => Ok(picture),
            })
            .map_err(|p| CaptureError::file(path, format!("line {}: {p}", i + 1)))?;
        found.push((picture, seconds));
    }
    Ok(found)
}

/// 16-bit grey PNM as stored, binary (`P5`): the form in which raw disparities are kept. One byte a
/// value where the largest is below 256, else two, the higher first.
pub fn read_pgm(path: &Path) -> Result<Image<u16>, CalibrateError> {
    let bytes = encoded::read(path).map_err(|e| CaptureError::io(path, e))?;
    pgm(&bytes).map_err(|problem| CaptureError::file(path, problem).into())
}

fn pgm(bytes: &[u8]) -> Result<Image<u16>, String> {
    let mut rest = bytes.strip_prefix(b"P5").ok_or("not a binary PGM picture")?;
    let mut number = || -> Result<usize, String> {
        loop {
            rest = rest.trim_ascii_start();
            if !rest.starts_with(b"#") {
                break;
            }
            let end = rest.iter().position(|&b| b == b'\n').ok_or("the header is cut off")?;
            rest = &rest[end..];
        }
        let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        let text = std::str::from_utf8(&rest[..digits]).map_err(|e| e.to_string())?;
        rest = &rest[digits..];
        text.parse().map_err(|_| "the header is no PGM header".to_owned())
    };
    let (width, height, largest) = (number()?, number()?, number()?);
    let pixels = width.saturating_mul(height);
    if pixels == 0 || pixels > MAX_PIXELS || !(1..=0xffff).contains(&largest) {
        return Err(format!("{width}x{height} pixels up to {largest}"));
    }
    let data = rest.get(1..).ok_or("no pixels")?;
    let there = if largest < 256 { data.len() } else { data.len() / 2 };
    if there < pixels {
        return Err(format!("{there} of {pixels} pixels: the file is cut off"));
    }
    let values = if largest < 256 {
        data[..pixels].iter().map(|&b| u16::from(b)).collect()
    } else {
        data.as_chunks::<2>().0[..pixels].iter().map(|b| u16::from_be_bytes(*b)).collect()
    };
    Ok(Image::from_vec(Size::new(width, height), values))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_say_what_belongs_together() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["2-c.jpg", "10-c.JPG", "2-d.pgm", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let keys = |pattern: &str, extensions: &[&str]| {
            find_pictures(&folder.path().join(pattern), extensions)
                .map(|found| found.into_iter().map(|p| p.key).collect::<Vec<_>>())
        };
        assert_eq!(keys("*-c.jpg", &COLOR_EXTENSIONS).unwrap(), ["2"]);
        assert_eq!(keys("*-d.pgm", &["pgm"]).unwrap(), ["2"]);
        assert_eq!(keys("", &COLOR_EXTENSIONS).unwrap().len(), 2);
        assert!(keys("*-e.jpg", &COLOR_EXTENSIONS).is_err());
    }

    #[test]
    fn exposure_lists_stay_in_their_folder() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("list");
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(root.path().join("a.png"), "").unwrap();
        let path = folder.join("list.txt");
        let read = |content: &str| {
            std::fs::write(&path, content).unwrap();
            read_exposure_list(&path)
        };
        let good = read("# stops\na.png 0.01\nb/c d.png 0.02 # twice\n").unwrap();
        assert_eq!(good, [(folder.join("a.png"), 0.01), (folder.join("b/c d.png"), 0.02)]);
        for bad in ["../a.png 1\n", "/etc/a.png 1\n", "b/../../a.png 1\n"] {
            let error = read(&format!("a.png 1\n{bad}")).unwrap_err().to_string();
            assert!(error.contains("line 2") && error.contains("outside"), "{error}");
        }
        assert!(read("a.png\n").unwrap_err().to_string().contains("seconds"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("../a.png", folder.join("l.png")).unwrap();
            assert!(read("l.png 1\n").unwrap_err().to_string().contains("link"));
        }
    }

    #[test]
    fn pgm_headers_and_hostile_files() {
        let two = pgm(b"P5\n# made\n2 1\n2047\n\x07\xff\x01\x02").unwrap();
        assert_eq!(two.as_slice(), [2047, 258]);
        assert_eq!(pgm(b"P5 2 1 255 \x07\xff").unwrap().as_slice(), [7, 255]);
        let bad: [&[u8]; 6] = [
            b"",
            b"P5",
            b"P5 2 1 2047\n\x07",
            b"P5 0 1 255 ",
            b"P5 99999999 99999999 255 ",
            b"P6 1 1 255 a",
        ];
        for bytes in bad {
            assert!(pgm(bytes).is_err(), "{bytes:?}");
        }
    }
}
