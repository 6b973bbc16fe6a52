//! Typed arrays of a glTF asset, with every offset and length checked.

use super::budget::Budget;
use gltf::accessor::sparse::IndexType;
use gltf::accessor::{Accessor, DataType};
use gltf::buffer::View;

/// The bytes of all buffers, by index, and what may be made of them.
pub struct Buffers {
    pub bytes: Vec<Vec<u8>>,
    pub budget: Budget,
}

impl Buffers {
    /// The bytes of a buffer view.
    pub fn view(&self, view: &View) -> Result<&[u8], String> {
        let buffer = &self.bytes[view.buffer().index()];
        view.offset()
            .checked_add(view.length())
            .and_then(|end| buffer.get(view.offset()..end))
            .ok_or_else(|| format!("buffer view {} reaches past its buffer", view.index()))
    }

    /// Elements of `N` components as floats; normalised integers become [0, 1] or [-1, 1].
    pub fn floats<const N: usize>(&self, accessor: &Accessor) -> Result<Vec<[f32; N]>, String> {
        let normalized = accessor.normalized();
        self.elements(accessor, |kind, bytes| component(kind, bytes) * scale(kind, normalized)).map(
            |mut rows| {
                // The spec clamps -128/127 and -32768/32767 to -1.
                if normalized {
                    rows.iter_mut().flatten().for_each(|v: &mut f32| *v = v.max(-1.0));
                }
                rows
            },
        )
    }

    /// Elements of `N` unsigned integers.
    pub fn integers<const N: usize>(&self, accessor: &Accessor) -> Result<Vec<[u32; N]>, String> {
        match accessor.data_type() {
            DataType::U8 | DataType::U16 | DataType::U32 => {
                self.elements(accessor, |_, bytes| unsigned(bytes))
            }
            other => Err(format!("accessor {}: indices of type {other:?}", accessor.index())),
        }
    }

    fn elements<T: Copy + Default, const N: usize>(
        &self,
        accessor: &Accessor,
        read: impl Fn(DataType, &[u8]) -> T,
    ) -> Result<Vec<[T; N]>, String> {
        let (count, kind) = (accessor.count(), accessor.data_type());
        let problem = |what: String| format!("accessor {}: {what}", accessor.index());
        if accessor.dimensions().multiplicity() != N {
            return Err(problem(format!(
                "{:?} where {N} components belong",
                accessor.dimensions()
            )));
        }
        let width = kind.size();
        let element =
            |bytes: &[u8]| std::array::from_fn(|c| read(kind, &bytes[c * width..][..width]));
        let mut out = match accessor.view() {
            None => {
                // Zeros, as many as the file says: nothing in it stands for them.
                self.budget.take(count, size_of::<[T; N]>() as u64).map_err(problem)?;
                vec![[T::default(); N]; count]
            }
            Some(view) => {
                let stride = view.stride().unwrap_or(N * width);
                let bytes = self.view(&view)?;
                strided(bytes, accessor.offset(), stride, N * width, count)
                    .map_err(problem)?
                    .map(element)
                    .collect()
            }
        };
        if let Some(sparse) = accessor.sparse() {
            let (indices, values) = (sparse.indices(), sparse.values());
            let index_width = match indices.index_type() {
                IndexType::U8 => 1,
                IndexType::U16 => 2,
                IndexType::U32 => 4,
            };
            let (index_view, value_view) = (indices.view(), values.view());
            let (index_bytes, value_bytes) = (self.view(&index_view)?, self.view(&value_view)?);
            let n = sparse.count();
            let at = strided(index_bytes, indices.offset(), index_width, index_width, n);
            let values = strided(value_bytes, values.offset(), N * width, N * width, n);
            for (index, value) in at.map_err(problem)?.zip(values.map_err(problem)?) {
                let index = unsigned(index) as usize;
                *out.get_mut(index)
                    .ok_or_else(|| problem(format!("sparse index {index} of {count}")))? =
                    element(value);
            }
        }
        Ok(out)
    }
}

/// `count` pieces of `size` bytes, `stride` bytes apart; the last need not be padded.
fn strided(
    bytes: &[u8],
    offset: usize,
    stride: usize,
    size: usize,
    count: usize,
) -> Result<impl Iterator<Item = &[u8]>, String> {
    if stride < size {
        return Err(format!("elements of {size} bytes every {stride} bytes"));
    }
    let end = match count {
        0 => Some(offset),
        _ => (count - 1)
            .checked_mul(stride)
            .and_then(|n| n.checked_add(size))
            .and_then(|n| n.checked_add(offset)),
    };
    let used = end.and_then(|end| bytes.get(offset..end)).ok_or_else(|| {
        format!("{count} elements do not fit the {} bytes of the buffer view", bytes.len())
    })?;
    Ok(used.chunks(stride).map(move |piece| &piece[..size]))
}

fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |w, &b| w << 8 | u32::from(b))
}

fn component(kind: DataType, bytes: &[u8]) -> f32 {
    let word = unsigned(bytes);
    match kind {
        DataType::I8 => f32::from(word as u8 as i8),
        DataType::I16 => f32::from(word as u16 as i16),
        DataType::U8 | DataType::U16 | DataType::U32 => word as f32,
        DataType::F32 => f32::from_bits(word),
    }
}

fn scale(kind: DataType, normalized: bool) -> f32 {
    match kind {
        _ if !normalized => 1.0,
        DataType::I8 => 1.0 / 127.0,
        DataType::U8 => 1.0 / 255.0,
        DataType::I16 => 1.0 / 32_767.0,
        DataType::U16 => 1.0 / 65_535.0,
        DataType::U32 | DataType::F32 => 1.0,
    }
}
