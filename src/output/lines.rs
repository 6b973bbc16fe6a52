//! Logs that are valid after every line.

use super::{OutputError, atomic};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A text file that grows by whole lines. Each line is handed to the system at once, so that it
/// survives the program.
#[derive(Debug)]
pub struct LineWriter {
    path: PathBuf,
    file: File,
    /// Bytes of whole lines written.
    length: u64,
}

impl LineWriter {
    /// Starts the file anew, making its folder where that is missing.
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        let file = atomic::create(path).map_err(|error| OutputError::io(path, error))?;
        Ok(Self { path: path.to_owned(), file, length: 0 })
    }

    /// Appends a line. Where only part of it could be written, that part is taken back.
    ///
    /// # Errors
    /// It cannot be written, or the file was removed: lines would go nowhere.
    pub fn push(&mut self, line: &str) -> Result<(), OutputError> {
        self.check()?;
        let bytes = format!("{line}\n").into_bytes();
        if let Err(error) = self.file.write_all(&bytes) {
            self.take_back();
            return Err(OutputError::io(&self.path, error));
        }
        self.length += bytes.len() as u64;
        Ok(())
    }

    /// # Errors
    /// The file was removed since it was started.
    pub fn check(&self) -> Result<(), OutputError> {
        match std::fs::symlink_metadata(&self.path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                Err(OutputError::content(&self.path, "was removed while it was being written"))
            }
            _ => Ok(()), // another problem shows when a line is written
        }
    }

    /// Waits until all lines are on the disk, so that they survive a power cut as well.
    pub fn sync(&self) -> Result<(), OutputError> {
        self.file.sync_all().map_err(|error| OutputError::io(&self.path, error))
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    fn take_back(&mut self) {
        use std::io::{Seek, SeekFrom};
        // Where this fails as well (a device, a lost disk) there is nothing more to save.
        if self.file.set_len(self.length).is_ok() {
            let _ = self.file.seek(SeekFrom::Start(self.length));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_line_is_there_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("logs/a.txt");
        let mut log = LineWriter::create(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "");
        log.push("one").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "one\n");
        log.push("two").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "one\ntwo\n");
        LineWriter::create(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "", "started anew");
    }

    #[test]
    fn part_of_a_line_is_taken_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let mut log = LineWriter::create(&path).unwrap();
        log.push("whole").unwrap();
        log.file.write_all(b"par").unwrap(); // as a disk that fills up would leave it
        log.take_back();
        log.push("next").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "whole\nnext\n");
    }

    #[test]
    fn a_file_that_was_removed_takes_no_lines() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("logs/a.txt");
        let mut log = LineWriter::create(&path).unwrap();
        log.push("one").unwrap();
        std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
        let error = log.push("two").unwrap_err().to_string();
        assert!(error.ends_with("a.txt: was removed while it was being written"), "{error}");
        assert!(!path.parent().unwrap().exists(), "it is not made again");
    }

    #[test]
    fn a_full_disk_is_a_clear_error() {
        let full = Path::new("/dev/full");
        if !full.exists() {
            println!("SKIPPED: no /dev/full here");
            return;
        }
        let mut log = LineWriter::create(full).unwrap();
        for _ in 0..2 {
            let error = log.push("line").unwrap_err();
            assert!(matches!(error, OutputError::DiskFull { .. }), "{error}");
            assert!(error.to_string().starts_with("/dev/full: no space left on the disk"));
        }
    }
}
