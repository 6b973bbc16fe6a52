//! Storage of 8x8x8 voxel blocks: a dense table of slots, and slots in one growing array.

use super::crossings::{Bricks, Sides};

/// Voxels a side of a block.
pub(crate) const SIDE: usize = 8;
/// Voxels of a block, x fastest.
pub(crate) const VOXELS: usize = SIDE * SIDE * SIDE;
/// Stored distance of one truncation length.
pub(crate) const ONE: i16 = i16::MAX;
/// Stored distance of a voxel that no frame has seen. Readers of distances need no weights.
pub(crate) const UNSEEN: i16 = i16::MIN;
/// Table entry of a block without storage: slot 0 holds one unseen block that stands for all of
/// them, so that a reader may follow any entry.
pub(crate) const EMPTY: u32 = 0;

/// Slots are added in chunks of this many, 2 MiB.
const GROWTH: usize = 1024;

#[derive(Debug)]
pub(super) struct Block {
    pub coords: [u16; 3],
    pub live: bool,
    /// Smallest seen distance; `ONE` where nothing was seen. A block that holds part of a front
    /// face, or whose neighbour does, has voxels below zero.
    pub lowest: i16,
    pub sides: Sides,
    /// Distances and weights lie apart: ray casting reads distances only.
    pub tsdf: [i16; VOXELS],
    pub weight: [u16; VOXELS],
    pub color: Option<Box<ColorBlock>>,
}

/// Running average of 8-bit sRGB, and its weight.
pub(crate) type ColorBlock = [[u8; 4]; VOXELS];

impl Block {
    fn clear(&mut self, coords: [u16; 3]) {
        self.coords = coords;
        self.live = true;
        self.lowest = ONE;
        self.sides = Sides::default();
        self.tsdf.fill(UNSEEN);
        self.weight.fill(0);
        if let Some(color) = &mut self.color {
            color.fill([0; 4]);
        }
    }
}

#[derive(Debug)]
pub(super) struct BlockStore {
    /// Blocks a side.
    pub grid: usize,
    /// Slot of each block, x fastest.
    pub table: Vec<u32>,
    /// Where each block may hold surface, in the table's order; 0 without storage.
    pub crossings: Vec<Bricks>,
    pub blocks: Vec<Block>,
    free: Vec<u32>,
    color: bool,
}

impl BlockStore {
    pub fn new(grid: usize, color: bool) -> Self {
        let table = vec![EMPTY; grid * grid * grid];
        let crossings = vec![0; table.len()];
        let (blocks, free) = (Vec::new(), Vec::new());
        let mut store = Self { grid, table, crossings, blocks, free, color };
        store.push();
        store
    }

    pub fn clear(&mut self) {
        self.table.fill(EMPTY);
        self.crossings.fill(0);
        self.blocks.truncate(1);
        self.free.clear();
    }

    pub fn live_blocks(&self) -> usize {
        self.blocks.len() - 1 - self.free.len()
    }

    pub fn index(&self, coords: [u16; 3]) -> usize {
        let [x, y, z] = coords.map(usize::from);
        (z * self.grid + y) * self.grid + x
    }

    pub fn coords(&self, index: usize) -> [u16; 3] {
        let (grid, row) = (self.grid, index / self.grid);
        [index % grid, row % grid, row / grid].map(|v| v as u16)
    }

    /// Gives the block at a table index storage, if it has none.
    pub fn allocate(&mut self, index: usize) {
        if self.table[index] != EMPTY {
            return;
        }
        let coords = self.coords(index);
        let slot = self.free.pop().unwrap_or_else(|| self.push());
        self.blocks[slot as usize].clear(coords);
        self.table[index] = slot;
    }

    pub fn release(&mut self, slot: u32) {
        let block = &mut self.blocks[slot as usize];
        debug_assert!(block.live);
        block.live = false;
        let index = self.index(self.blocks[slot as usize].coords);
        self.table[index] = EMPTY;
        self.crossings[index] = 0;
        self.free.push(slot);
    }

    fn push(&mut self) -> u32 {
        if self.blocks.len() == self.blocks.capacity() {
            self.blocks.reserve_exact(GROWTH.max(self.blocks.len() / 8));
        }
        let slot = self.blocks.len() as u32;
        self.blocks.push(Block {
            coords: [0; 3],
            live: false,
            lowest: ONE,
            sides: Sides::default(),
            tsdf: [UNSEEN; VOXELS],
            weight: [0; VOXELS],
            color: self.color.then(|| Box::new([[0; 4]; VOXELS])),
        });
        slot
    }

    /// The blocks around `coords` that have storage, itself included.
    pub fn neighbourhood(&self, coords: [u16; 3]) -> impl Iterator<Item = &Block> {
        let grid = self.grid;
        let range = |v: u16| {
            let v = usize::from(v);
            v.saturating_sub(1)..(v + 2).min(grid)
        };
        let [rx, ry, rz] = coords.map(range);
        rz.flat_map(move |z| {
            let rx = rx.clone();
            ry.clone().flat_map(move |y| rx.clone().map(move |x| (z * grid + y) * grid + x))
        })
        .map(|index| self.table[index])
        .filter(|&slot| slot != EMPTY)
        .map(|slot| &self.blocks[slot as usize])
    }

    pub fn memory_bytes(&self) -> usize {
        let colors = if self.color { self.blocks.len() * size_of::<ColorBlock>() } else { 0 };
        self.table.capacity() * size_of::<u32>()
            + self.crossings.capacity() * size_of::<Bricks>()
            + self.blocks.capacity() * size_of::<Block>()
            + self.free.capacity() * size_of::<u32>()
            + colors
    }
}
