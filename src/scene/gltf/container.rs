//! The bytes of a glTF asset: the GLB container, and what its URIs name.

use super::budget::Budget;
use crate::files;
use crate::scene::error::read_limited;
use std::path::Path;

/// glTF JSON and the binary chunk of a GLB file.
pub struct Container<'a> {
    pub json: &'a [u8],
    pub binary: Option<&'a [u8]>,
}

const JSON_CHUNK: u32 = u32::from_le_bytes(*b"JSON");
const BINARY_CHUNK: u32 = u32::from_le_bytes(*b"BIN\0");

/// Splits a GLB file; anything without its magic number is taken for plain glTF JSON.
pub fn split(data: &[u8]) -> Result<Container<'_>, String> {
    let Some(rest) = data.strip_prefix(b"glTF") else {
        return Ok(Container { json: data, binary: None });
    };
    let header = rest.get(..8).ok_or("the GLB header is cut off")?;
    let (version, length) = (word(&header[..4]), word(&header[4..]) as usize);
    if version != 2 {
        return Err(format!("GLB version {version}; only version 2 is read"));
    }
    if length > data.len() {
        return Err(format!("cut off: the header says {length} bytes, there are {}", data.len()));
    }
    let mut rest = data.get(12..length).ok_or("the GLB header gives a length below its own")?;
    let (kind, json) = next_chunk(&mut rest)?;
    if kind != JSON_CHUNK {
        return Err("the first GLB chunk is not JSON".to_owned());
    }
    let mut binary = None;
    while binary.is_none() && !rest.is_empty() {
        let (kind, chunk) = next_chunk(&mut rest)?;
        binary = (kind == BINARY_CHUNK).then_some(chunk); // unknown chunks are skipped
    }
    Ok(Container { json, binary })
}

fn word(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |w, &b| w << 8 | u32::from(b))
}

fn next_chunk<'a>(rest: &mut &'a [u8]) -> Result<(u32, &'a [u8]), String> {
    let header = rest.get(..8).ok_or("a GLB chunk header is cut off")?;
    let length = word(&header[..4]) as usize;
    let chunk = rest[8..].get(..length).ok_or_else(|| {
        format!("a GLB chunk of {length} bytes is cut off after {}", rest.len() - 8)
    })?;
    *rest = &rest[8 + length..];
    Ok((word(&header[4..]), chunk))
}

/// The bytes of a `data:` URI, or of a file in `folder` or below it.
pub fn read_uri(uri: &str, folder: &Path, budget: &Budget) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, encoded) = data.split_once(";base64,").ok_or("a data URI that is not base64")?;
        return decode_base64(encoded);
    }
    let name = decode_percent(uri).ok_or_else(|| format!("bad escape in the URI {uri:?}"))?;
    let path = files::inside(folder, &name).ok().filter(|_| !uri.contains(':'));
    let path =
        path.ok_or_else(|| format!("refers to {uri:?}; only files in its own folder are read"))?;
    if files::leads_out(folder, &path) {
        return Err(format!("{}: leads out of the folder of the model", path.display()));
    }
    let bytes = read_limited(&path, budget.file_limit()).map_err(|e| e.to_string())?;
    budget.add_file(bytes.len());
    Ok(bytes)
}

fn decode_percent(text: &str) -> Option<String> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(b) = bytes.next() {
        if b == b'%' {
            let mut digit = || char::from(bytes.next()?).to_digit(16);
            out.push((digit()? * 16 + digit()?) as u8);
        } else {
            out.push(b);
        }
    }
    String::from_utf8(out).ok()
}

fn decode_base64(text: &str) -> Result<Vec<u8>, String> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let (mut bits, mut count) = (0u32, 0);
    for b in text.trim_end_matches('=').bytes() {
        let value = match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return Err("a data URI with bytes that are not base64".to_owned()),
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
        }
    }
    if count >= 6 { Err("a data URI that ends early".to_owned()) } else { Ok(out) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_and_escapes() {
        for (text, plain) in [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo")] {
            assert_eq!(decode_base64(text).unwrap(), plain.as_bytes());
        }
        assert_eq!(decode_base64("+/A=").unwrap(), [0xfb, 0xf0]);
        assert!(decode_base64("Zm9v!").is_err() && decode_base64("Zm9vY").is_err());
        assert_eq!(decode_percent("a%20b%2f").unwrap(), "a b/");
        assert!(decode_percent("%4").is_none() && decode_percent("%ff").is_none());
    }

    #[test]
    fn files_outside_the_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("in");
        std::fs::create_dir(&inside).unwrap();
        std::fs::write(folder.path().join("secret.bin"), b"no").unwrap();
        std::fs::write(inside.join("a b.bin"), b"yes").unwrap();
        let budget = Budget::default();
        let read = |uri: &str| read_uri(uri, &inside, &budget);
        assert_eq!(read("a%20b.bin").unwrap(), b"yes");
        assert_eq!(read("./a%20b.bin").unwrap(), b"yes");
        assert_eq!(Budget::default().file_limit() - budget.file_limit(), 6, "all files count");
        let absolute = folder.path().join("secret.bin").display().to_string();
        for uri in ["../secret.bin", "%2e%2e/secret.bin", "http://host/x", "file:x", &absolute] {
            assert!(read(uri).unwrap_err().contains("own folder"), "{uri}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.path().join("secret.bin"), inside.join("l")).unwrap();
            assert!(read("l").unwrap_err().contains("out of the folder"));
        }
        budget.add_file(usize::MAX);
        assert!(read("a%20b.bin").unwrap_err().contains("limit"));
    }

    #[test]
    fn every_truncation_of_a_glb_is_an_error() {
        let mut glb = b"glTF\x02\0\0\0\0\0\0\0\x04\0\0\0JSON{  }\x04\0\0\0BIN\0abcd".to_vec();
        let length = glb.len() as u32;
        glb[8..12].copy_from_slice(&length.to_le_bytes());
        let whole = split(&glb).unwrap();
        assert_eq!((whole.json, whole.binary), (&b"{  }"[..], Some(&b"abcd"[..])));
        for end in 4..glb.len() {
            assert!(split(&glb[..end]).is_err(), "{end}");
            let mut shorter = glb[..end].to_vec(); // with a header that agrees
            if end >= 12 {
                shorter[8..12].copy_from_slice(&(end as u32).to_le_bytes());
                // 24: after the JSON chunk, a valid file without a binary one
                assert_eq!(split(&shorter).is_ok(), end == 24, "{end}");
            }
        }
        glb[4] = 1;
        assert!(split(&glb).is_err());
    }
}
