//! How much memory an asset may take, for what its files hold.
//!
//! A few bytes of glTF can ask for any amount: a node shows a mesh again, a mesh an accessor, a material a
//! picture, and an accessor without a buffer is as many zeros as it says. So all that is made of an asset is
//! paid for before it is made, out of a sum that grows with the files' length.

use std::cell::Cell;

/// Every asset may take this much, so that small files may show their meshes many times.
const FREE_BYTES: u64 = 512 << 20;

/// And this much for each of its bytes. A vertex takes 8 bytes at least where it is stored once, a texel
/// half a bit.
const BYTES_FOR_BYTE: u64 = 128;

/// All files of an asset together.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// What a vertex costs: twice itself (in its part and in the model), and its accessors while they are read.
pub const VERTEX: u64 = 128;
/// Twice itself, and its indices.
pub const TRIANGLE: u64 = 36;
/// Itself with all halvings, and half of what decoding takes on the way.
pub const TEXEL: u64 = 8;
/// A primitive that a node shows, however empty.
pub const PRIMITIVE: u64 = 1024;
/// A joint's matrix.
pub const JOINT: u64 = 128;

/// What is left of it.
#[derive(Debug)]
pub struct Budget {
    memory: Cell<u64>,
    files: Cell<u64>,
}

impl Default for Budget {
    fn default() -> Self {
        Self { memory: Cell::new(FREE_BYTES), files: Cell::new(MAX_FILE_BYTES) }
    }
}

impl Budget {
    /// Length that the next file may have.
    pub fn file_limit(&self) -> u64 {
        self.files.get()
    }

    /// Counts a file, or a part of one, that was read.
    pub fn add_file(&self, bytes: usize) {
        let bytes = bytes as u64;
        self.files.set(self.files.get().saturating_sub(bytes));
        self.memory.set(self.memory.get().saturating_add(bytes.saturating_mul(BYTES_FOR_BYTE)));
    }

    /// Pays for `count` of what costs `each`.
    pub fn take(&self, count: usize, each: u64) -> Result<(), String> {
        let wanted = (count as u64).saturating_mul(each);
        let left = self.memory.get().checked_sub(wanted).ok_or_else(|| {
            format!("takes {} MiB more than files of this length may", wanted >> 20)
        })?;
        self.memory.set(left);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_falls_with_use_and_grows_with_files() {
        let budget = Budget::default();
        budget.take(1 << 20, 512).unwrap();
        assert!(budget.take(1, 1).unwrap_err().contains("MiB"));
        budget.add_file(2);
        budget.take(256, 1).unwrap();
        assert!(budget.take(usize::MAX, u64::MAX).is_err());
        budget.take(0, VERTEX).unwrap();
        assert_eq!(budget.file_limit(), MAX_FILE_BYTES - 2);
        budget.add_file(usize::MAX);
        assert_eq!(budget.file_limit(), 0);
    }
}
