//! How far around each block there is no surface: rays pass the cube of such blocks at once.

use super::TsdfVolume;
use super::block::BlockStore;

/// Distances are not followed further than this many blocks.
pub(crate) const FARTHEST: u8 = 16;

/// For each block, how many blocks away (the largest of the three axes) the nearest one is that may
/// hold surface; 0 is such a block itself. Rebuilt in well below a millisecond: a row of blocks along x
/// is one word, as a volume has at most 64 blocks a side.
#[derive(Debug, Default)]
pub(crate) struct EmptySpace {
    distance: Vec<u8>,
    /// Rows of blocks within the distance reached so far, and one step further.
    reached: Vec<u64>,
    wider: Vec<u64>,
    along_y: Vec<u64>,
}

impl EmptySpace {
    /// Takes in what the volume holds now.
    pub fn survey(&mut self, volume: &TsdfVolume) {
        self.survey_blocks(&volume.store);
    }

    /// Distances in the order of the volume's table.
    pub(crate) fn distances(&self) -> &[u8] {
        &self.distance
    }

    fn survey_blocks(&mut self, store: &BlockStore) {
        let grid = store.grid;
        self.distance.clear();
        self.distance.resize(store.table.len(), FARTHEST);
        self.reached.clear();
        self.reached.extend(store.crossings.chunks_exact(grid).map(|row| {
            row.iter().enumerate().fold(0, |bits, (x, &c)| bits | u64::from(c != 0) << x)
        }));
        self.wider.resize(self.reached.len(), 0);
        self.along_y.resize(self.reached.len(), 0);
        for (row, &bits) in self.reached.iter().enumerate() {
            mark(&mut self.distance[row * grid..][..grid], bits, 0);
        }
        for distance in 1..FARTHEST {
            self.widen(grid);
            let mut any = 0;
            for (row, (&wide, &narrow)) in self.wider.iter().zip(&self.reached).enumerate() {
                let new = wide & !narrow;
                mark(&mut self.distance[row * grid..][..grid], new, distance);
                any |= new;
            }
            std::mem::swap(&mut self.reached, &mut self.wider);
            if any == 0 {
                break;
            }
        }
    }

    /// `wider` becomes the blocks in or beside those of `reached`.
    fn widen(&mut self, grid: usize) {
        let inside = u64::MAX >> (64 - grid);
        let beside = |rows: &[u64], at: usize, index: usize, stride: usize| {
            let before = if index > 0 { rows[at - stride] } else { 0 };
            let after = if index + 1 < grid { rows[at + stride] } else { 0 };
            rows[at] | before | after
        };
        for at in 0..self.reached.len() {
            self.along_y[at] = beside(&self.reached, at, at % grid, 1);
        }
        for at in 0..self.reached.len() {
            let bits = beside(&self.along_y, at, at / grid, grid);
            self.wider[at] = (bits | bits << 1 | bits >> 1) & inside;
        }
    }
}

fn mark(row: &mut [u8], mut bits: u64, distance: u8) {
    while bits != 0 {
        row[bits.trailing_zeros() as usize] = distance;
        bits &= bits - 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    #[test]
    fn distances_are_those_of_the_nearest_block() {
        for (grid, blocks) in [(1, 1), (5, 2), (24, 4), (64, 3), (9, 0)] {
            let mut store = BlockStore::new(grid, false);
            let mut rng = Rng::new(&[grid as u32]);
            let pick = |rng: &mut Rng| ((rng.uniform() * grid as f32) as usize).min(grid - 1);
            let places: Vec<[usize; 3]> =
                (0..blocks).map(|_| [0; 3].map(|_| pick(&mut rng))).collect();
            for [x, y, z] in &places {
                store.crossings[(z * grid + y) * grid + x] = 1 << 40;
            }
            let mut space = EmptySpace::default();
            space.survey_blocks(&store);
            for (index, &found) in space.distances().iter().enumerate() {
                let here = [index % grid, index / grid % grid, index / (grid * grid)];
                let away = |p: &[usize; 3]| (0..3).map(|i| p[i].abs_diff(here[i])).max().unwrap();
                let nearest = places.iter().map(away).min().unwrap_or(usize::MAX);
                assert_eq!(usize::from(found), nearest.min(usize::from(FARTHEST)), "{here:?}");
            }
        }
    }
}
