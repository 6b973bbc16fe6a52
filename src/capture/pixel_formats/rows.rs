//! Rows of a picture in a buffer.

/// Bytes of a picture's row without padding, and rows.
#[derive(Clone, Copy)]
pub(in crate::capture) struct Rows {
    pub row: usize,
    pub count: usize,
}

impl Rows {
    /// The rows, `stride` bytes apart, without what pads them.
    ///
    /// # Errors
    /// Rows that overlap, or fewer bytes than there should be: both numbers are said.
    pub fn of(self, data: &[u8], stride: usize) -> Result<impl Iterator<Item = &[u8]>, String> {
        let Self { row, count } = self;
        if stride < row || stride == 0 {
            return Err(format!("rows {stride} bytes apart hold no {row} bytes"));
        }
        // The last row needs no padding.
        let needed =
            count.checked_sub(1).map_or(0, |n| n.saturating_mul(stride).saturating_add(row));
        if data.len() < needed {
            return Err(format!("{} of {needed} bytes", data.len()));
        }
        Ok(data.chunks(stride).take(count).map(move |r| &r[..row]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_is_skipped_and_short_data_are_refused() {
        let data: Vec<u8> = (0..14).collect();
        let rows = Rows { row: 4, count: 3 };
        let found: Vec<_> = rows.of(&data, 5).unwrap().map(<[u8]>::to_vec).collect();
        assert_eq!(found, [[0, 1, 2, 3], [5, 6, 7, 8], [10, 11, 12, 13]]);
        let fails = |stride, bytes: usize, what: &str| {
            let error = rows.of(&data[..bytes], stride).err().expect(what);
            assert!(error.contains(what), "{error}");
        };
        fails(5, 13, "13 of 14 bytes");
        fails(3, 14, "hold no 4 bytes");
        fails(0, 14, "0 bytes apart");
        fails(usize::MAX, 14, "14 of");
        let none = Rows { row: 4, count: 0 };
        assert_eq!(none.of(&[], 4).unwrap().count(), 0);
    }
}
