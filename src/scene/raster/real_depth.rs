//! The real depth around a pixel.

use crate::geometry::GBuffer;
use crate::image::Image;
use std::ops::Range;

/// Least and largest real depth around each pixel of a row.
#[derive(Debug, Default)]
pub struct RealRange {
    /// Of three rows, from one column before the first to one after the last.
    near: Vec<f32>,
    far: Vec<f32>,
}

impl RealRange {
    pub fn set_row(&mut self, real: &GBuffer, y: usize, columns: Range<usize>) {
        let depth = &real.depth_m;
        let (width, height) = (depth.width(), depth.height());
        let padded = columns.start.saturating_sub(1)..(columns.end + 1).min(width);
        let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)]
            .map(|row| &depth.row(row)[padded.clone()]);
        let known = |d: f32| if d > 0.0 { d } else { f32::INFINITY };
        self.near.clear();
        self.far.clear();
        for i in 0..padded.len() {
            let [a, b, c] = [known(rows[0][i]), known(rows[1][i]), known(rows[2][i])];
            self.near.push(a.min(b).min(c));
            self.far.push(a.max(b).max(c));
        }
        // The image ends with its last column: repeat it, so that every pixel has two neighbours.
        for list in [&mut self.near, &mut self.far] {
            if columns.start == 0 {
                list.insert(0, list[0]);
            }
            if columns.end == width {
                list.push(list[list.len() - 1]);
            }
        }
    }

    /// For the columns of the last row set, in order.
    pub fn iter(&self) -> impl Iterator<Item = (f32, f32)> {
        let near = self.near.windows(3).map(|w| w[0].min(w[1]).min(w[2]));
        near.zip(self.far.windows(3).map(|w| w[0].max(w[1]).max(w[2])))
    }
}

/// The real depth of 3x3 pixels; missing is infinitely far.
pub struct Neighbourhood {
    pub depth: [[f32; 3]; 3],
    /// Distance in pixels of columns and rows from the middle one; 0 where the image ends.
    pub step_x: [f32; 3],
    pub step_y: [f32; 3],
}

impl Neighbourhood {
    pub fn new(depth: &Image<f32>, x: usize, y: usize) -> Self {
        let columns = [x.saturating_sub(1), x, (x + 1).min(depth.width() - 1)];
        let rows = [y.saturating_sub(1), y, (y + 1).min(depth.height() - 1)];
        Self {
            depth: rows.map(|row| {
                let row = depth.row(row);
                columns.map(|column| if row[column] > 0.0 { row[column] } else { f32::INFINITY })
            }),
            step_x: columns.map(|column| column as f32 - x as f32),
            step_y: rows.map(|row| row as f32 - y as f32),
        }
    }
}
