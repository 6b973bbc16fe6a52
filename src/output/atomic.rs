//! Files that are there as a whole or not at all.

use super::OutputError;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Creates or replaces `path` with what `write` writes.
///
/// Missing folders are made. If anything fails, the old file stays as it was and the temporary one is
/// removed. A killed process may leave a hidden `.NAME.PID-N.tmp` behind. Files are not forced to the
/// disk: this guards against a killed program, not against a power cut.
pub fn atomic_write(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), OutputError> {
    let temporary = temporary_beside(path)?;
    let result = create(&temporary)
        .and_then(|file| fill(file, write))
        .and_then(|()| std::fs::rename(&temporary, path));
    result.map_err(|error| {
        let _ = std::fs::remove_file(&temporary); // it may not exist, and the first error counts
        OutputError::io(path, error)
    })
}

/// A name in the folder of `path` that nothing else uses.
pub(super) fn temporary_beside(path: &Path) -> Result<PathBuf, OutputError> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let name = path
        .file_name()
        .ok_or_else(|| OutputError::content(path, "not a file name to write to"))?
        .to_string_lossy();
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    Ok(path.with_file_name(format!(".{name}.{}-{count}.tmp", std::process::id())))
}

/// Opens a new file, making its folder where that is missing.
pub(super) fn create(path: &Path) -> io::Result<File> {
    match File::create(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            std::fs::create_dir_all(path.parent().unwrap_or(Path::new("")))?;
            File::create(path)
        }
        result => result,
    }
}

fn fill(file: File, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    write(&mut buffered)?;
    buffered.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_is_replaced_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/folder/file.txt");
        atomic_write(&path, |w| w.write_all(b"first")).unwrap();
        atomic_write(&path, |w| {
            w.write_all(&[b'x'; 200_000])?; // more than the buffer holds
            assert_eq!(std::fs::read(&path).unwrap(), b"first", "old until complete");
            Ok(())
        })
        .unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), [b'x'; 200_000]);
        assert_eq!(names(path.parent().unwrap()), ["file.txt"]);
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file.txt");
        atomic_write(&path, |w| w.write_all(b"old")).unwrap();
        let error = atomic_write(&path, |w| {
            w.write_all(b"half")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        })
        .unwrap_err();
        let message = error.to_string();
        assert!(message.contains("file.txt: no space left on the disk"), "{message}");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["file.txt"]);
    }

    #[test]
    fn a_full_disk_is_noticed_even_at_the_last_flush() {
        let Ok(full) = File::options().write(true).open("/dev/full") else {
            println!("SKIPPED: no /dev/full here");
            return;
        };
        let error = fill(full, |w| w.write_all(b"fits into the buffer")).unwrap_err();
        let message = OutputError::io(Path::new("out/a.png"), error).to_string();
        assert!(message.starts_with("out/a.png: no space left on the disk"), "{message}");
    }

    #[test]
    fn impossible_paths_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, b"in the way").unwrap();
        let below = file.join("below.txt");
        let message = atomic_write(&below, |_| Ok(())).unwrap_err().to_string();
        assert!(message.contains("below.txt: cannot write"), "{message}");
        assert!(atomic_write(Path::new("/"), |_| Ok(())).is_err());
        // a folder of that name
        let message = atomic_write(folder.path(), |_| Ok(())).unwrap_err().to_string();
        assert!(message.contains("cannot write"), "{message}");
    }
}
