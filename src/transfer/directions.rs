//! The directions in which visibility is sampled, with everything that depends on them alone.

use super::hull::{convex_hull, edges};
use super::{ChiReading, TransferError, TransferParams};
use crate::math::random::{hash, unit_f32};
use crate::math::sh;
use glam::{DQuat, DVec3, Vec3};
use std::f64::consts::{PI, TAU};

/// Pixels that a kernel treats at once.
pub(super) const LANES: usize = 16;

/// Directions over the whole sphere, their spherical harmonics, and the sample distance of each
/// direction in each pixel of a repeating tile.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionSet {
    /// Unit vectors in world axes.
    pub directions: Vec<Vec3>,
    /// The solid angle that each direction stands for; all 4 pi / N together.
    pub solid_angle: f32,
    /// Median angle between neighbouring directions, radians.
    pub neighbour_angle: f32,
    /// Threshold of Eq. 8.
    pub chi: f32,
    bands: usize,
    tile: usize,
    /// Samples a direction.
    pub(super) samples: usize,
    /// `row_length` values of Y a direction, zero beyond the bands.
    rows: Vec<f32>,
    /// Metres; [tile row][tile column][chunk of slots]. A slot stands for one sample of one direction;
    /// slots beyond the last are 0.
    distances_m: Vec<[f32; LANES]>,
    slot_directions: Vec<u32>,
    /// No sample lies further away.
    pub(crate) farthest_m: f32,
}

impl DirectionSet {
    pub fn new(params: &TransferParams) -> Result<Self, TransferError> {
        params.check()?;
        let points = spread_points(params.directions, params.seed);
        let neighbour_angle = median_neighbour_angle(&points)
            .expect("a turned Fibonacci sphere of four or more points spans a volume");
        let cosine = (neighbour_angle / 2.0).cos();
        let chi = match params.chi {
            ChiReading::Text => 1.0 - cosine,
            ChiReading::Printed => cosine,
            ChiReading::Neighbour => 1.0 - neighbour_angle.cos(),
        };
        let directions: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
        let row_length = row_length(params.bands);
        let mut rows = vec![0.0; row_length * directions.len()];
        for (row, &direction) in rows.chunks_exact_mut(row_length).zip(&directions) {
            let n = sh::coefficients(params.bands);
            row[..n].copy_from_slice(&sh::basis(direction, params.bands)[..n]);
        }
        let distances_m = tiled_distances(params);
        Ok(Self {
            solid_angle: (4.0 * PI / directions.len() as f64) as f32,
            neighbour_angle: neighbour_angle as f32,
            chi: chi as f32,
            bands: params.bands,
            tile: params.jitter_tile,
            samples: params.samples,
            rows,
            farthest_m: distances_m.iter().flatten().copied().fold(0.0, f32::max),
            distances_m,
            slot_directions: (0..points.len() as u32)
                .flat_map(|direction| std::iter::repeat_n(direction, params.samples))
                .collect(),
            directions,
        })
    }

    pub fn len(&self) -> usize {
        self.directions.len()
    }

    pub(super) fn bands(&self) -> usize {
        self.bands
    }

    pub fn is_empty(&self) -> bool {
        self.directions.is_empty()
    }

    /// Side of the jitter tile in grid points.
    pub fn tile(&self) -> usize {
        self.tile
    }

    /// Distance in metres of the sample in `direction` at grid point (i, j).
    pub fn distance_m(&self, direction: usize, sample: usize, i: usize, j: usize) -> f32 {
        let slot = direction * self.samples + sample;
        self.distances(i % self.tile, j % self.tile)[slot / LANES][slot % LANES]
    }

    /// Distances of all slots at the grid points of one cell of the tile.
    #[inline(always)]
    pub(super) fn distances(&self, column: usize, row: usize) -> &[[f32; LANES]] {
        let chunks = self.chunks();
        let cell = row * self.tile + column;
        &self.distances_m[cell * chunks..(cell + 1) * chunks]
    }

    /// Lane arrays that hold one slot for each sample of each direction.
    pub(super) fn chunks(&self) -> usize {
        (self.len() * self.samples).div_ceil(LANES)
    }

    #[inline(always)]
    pub(super) fn direction_of(&self, slot: usize) -> usize {
        self.slot_directions[slot] as usize
    }

    /// The slots of a direction's samples.
    #[inline(always)]
    pub(super) fn slots(&self, direction: usize) -> std::ops::Range<usize> {
        direction * self.samples..(direction + 1) * self.samples
    }

    /// Y of a direction, padded with zeros to a multiple of 16.
    #[inline(always)]
    pub(crate) fn row(&self, direction: usize) -> &[f32] {
        let n = row_length(self.bands);
        &self.rows[direction * n..(direction + 1) * n]
    }
}

/// Coefficients of a row, rounded up to whole lane arrays.
pub(super) const fn row_length(bands: usize) -> usize {
    sh::coefficients(bands).next_multiple_of(LANES)
}

/// A spherical Fibonacci lattice, relaxed, and turned by a rotation that depends on the seed.
///
/// The lattice's own axis would otherwise favour the world's z axis, where floors are.
fn spread_points(n: usize, seed: u32) -> Vec<DVec3> {
    let golden = PI * (3.0 - 5f64.sqrt());
    let mut points: Vec<DVec3> = (0..n)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / n as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * cos, r * sin, z)
        })
        .collect();
    relax(&mut points);
    let turn = seeded_rotation(seed);
    points.into_iter().map(|p| (turn * p).normalize()).collect()
}

/// Lets the points repel each other like charges (Thomson's problem).
///
/// It halves the error with which the set integrates a clamped-cosine lobe in 4 bands, for
/// N = 16 from 17.5 % to 9.9 %, for 32 from 5.0 % to 2.6 %; for 128 0.57 % becomes 0.41 %, and
/// larger sets have no need of it. Weights by Voronoi cells gain less than a tenth after that,
/// so all directions weigh the same.
fn relax(points: &mut [DVec3]) {
    let n = points.len();
    let steps = (8_000_000 / (n * n)).min(400);
    let mut step = 0.5 * (n as f64).powf(-1.5);
    let mut forces = vec![DVec3::ZERO; n];
    for _ in 0..steps {
        for (i, force) in forces.iter_mut().enumerate() {
            let here = points[i];
            let repulsion = |other: &DVec3| {
                let d = here - *other;
                let squared = d.length_squared();
                // Nothing where the two are the same point.
                d / (squared * squared.sqrt()).max(f64::MIN_POSITIVE)
            };
            *force = points.iter().map(repulsion).sum();
        }
        for (point, force) in points.iter_mut().zip(&forces) {
            *point = (*point + force.reject_from_normalized(*point) * step).normalize();
        }
        step *= 0.995;
    }
}

/// A uniformly distributed rotation (Shoemake, Graphics Gems III).
fn seeded_rotation(seed: u32) -> DQuat {
    let [a, b, c] = [1, 2, 3].map(|k| f64::from(unit_f32(hash(seed ^ hash(k)))));
    let ((s1, c1), (s2, c2)) = ((TAU * b).sin_cos(), (TAU * c).sin_cos());
    let (p, q) = ((1.0 - a).sqrt(), a.sqrt());
    DQuat::from_xyzw(p * s1, p * c1, q * s2, q * c2).normalize()
}

/// Median over the edges of the spherical Delaunay triangulation (Eq. 9).
fn median_neighbour_angle(points: &[DVec3]) -> Option<f64> {
    let triangles = convex_hull(points)?;
    let mut angles: Vec<f64> =
        edges(&triangles).map(|(a, b)| points[a].angle_between(points[b])).collect();
    angles.sort_by(f64::total_cmp);
    let half = angles.len() / 2;
    Some((angles[half] + angles[(angles.len() - 1) / 2]) / 2.0)
}

/// Distances in (nearest, radius], denser near (as the square of a uniform share), since a small thing
/// nearby hides as much as a large one far off. Against the path-traced shadow of a figure of 18 cm,
/// three samples within 0.6 m find 69 % of what it hides, and four uniformly spaced ones within 1 m a third. Geometric
/// spacing does as well there and worse for walls (relative L2 error of transfer 0.48 against 0.41).
/// Stratified over the tile in each direction, and of low discrepancy
/// over the directions in each pixel.
///
/// Direction k has a fraction of k sqrt(2) (the lattice's azimuth uses up the golden ratio); each
/// cell of the tile adds its own of the evenly spaced shifts to it.
fn tiled_distances(params: &TransferParams) -> Vec<[f32; LANES]> {
    let tile = params.jitter_tile;
    let cells = (tile * tile) as f64;
    let (nearest_m, radius_m) = (f64::from(params.nearest_m), f64::from(params.radius_m));
    let start = f64::from(unit_f32(hash(params.seed ^ 0x5bd1_e995)));
    let slots = params.directions * params.samples;
    let mut out = vec![[0.0; LANES]; tile * tile * slots.div_ceil(LANES)];
    for (cell, chunks) in out.chunks_exact_mut(slots.div_ceil(LANES)).enumerate() {
        let stratum = cell_order(cell / tile, cell % tile, tile);
        let distances = chunks.as_flattened_mut()[..slots].iter_mut();
        for (slot, distance) in distances.enumerate() {
            let (direction, sample) = (slot / params.samples, slot % params.samples);
            let base = start + direction as f64 * std::f64::consts::SQRT_2;
            let within = 1.0 - (base + stratum as f64 / cells).fract();
            let share = (sample as f64 + within) / params.samples as f64;
            *distance = (nearest_m + (radius_m - nearest_m) * share * share) as f32;
        }
    }
    out
}

/// Which stratum a cell takes: neighbours along both axes lie far apart.
fn cell_order(row: usize, column: usize, tile: usize) -> usize {
    let diagonal = (row + column) % tile;
    diagonal * tile + column
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    fn set(directions: usize) -> DirectionSet {
        DirectionSet::new(&TransferParams { directions, ..TransferParams::default() }).unwrap()
    }

    #[test]
    fn half_the_neighbour_angle_is_as_expected() {
        // 25, 18, 13 and 9 degrees for the best spread sets; the median over a triangulation's edges lies
        // a little above: measured 27.0, 18.8, 13.4, 9.7.
        for (n, expected) in [(16, 25.0), (32, 18.0), (64, 13.0), (128, 9.0f32)] {
            let half = set(n).neighbour_angle.to_degrees() / 2.0;
            assert!((expected..expected * 1.1).contains(&half), "{n}: {half}");
        }
    }

    #[test]
    fn readings_of_chi() {
        let chi =
            |chi| DirectionSet::new(&TransferParams { chi, ..Default::default() }).unwrap().chi;
        // alpha = 37.5 degrees for 32 directions
        assert!((chi(ChiReading::Text) - 0.0531).abs() < 1e-3);
        assert!((chi(ChiReading::Neighbour) - 0.2066).abs() < 2e-3);
        assert!((chi(ChiReading::Printed) - 0.9469).abs() < 1e-3);
    }

    #[test]
    fn lobes_are_integrated_within_the_sampling_error() {
        // Relative L2 over 4 bands and random normals; measured 10, 2.6, 1.1, 0.41 and 0.17 %.
        for (n, limit) in [(16, 0.11), (32, 0.03), (64, 0.013), (128, 0.005), (256, 0.002)] {
            let set = set(n);
            let mut rng = Rng::new(&[3]);
            let (mut error, mut norm) = (0.0f64, 0.0f64);
            for _ in 0..200 {
                let normal = Vec3::from([0; 3].map(|_| rng.normal())).normalize();
                let exact = sh::unoccluded_transfer(normal, 4);
                for k in 0..16 {
                    let cosine = |j: usize| normal.dot(set.directions[j]).max(0.0);
                    let sum: f32 = (0..n).map(|j| cosine(j) * set.row(j)[k]).sum();
                    let quadrature = sum * set.solid_angle / std::f32::consts::PI;
                    error += f64::from(quadrature - exact[k]).powi(2);
                    norm += f64::from(exact[k]).powi(2);
                }
            }
            let relative = (error / norm).sqrt();
            println!("N = {n}: {:.2} %", 100.0 * relative);
            assert!(relative < limit, "{n}: {relative}");
        }
    }

    #[test]
    fn distances_cover_the_radius_as_squares_of_even_shares() {
        for (tile, samples) in [(1, 1), (2, 1), (3, 2), (4, 3)] {
            let params = TransferParams { jitter_tile: tile, samples, ..Default::default() };
            let (nearest_m, radius_m) = (params.nearest_m, params.radius_m);
            let set = DirectionSet::new(&params).unwrap();
            let cells = tile * tile;
            for direction in 0..set.len() {
                for sample in 0..samples {
                    let mut shares: Vec<f32> = (0..cells)
                        .map(|c| set.distance_m(direction, sample, c % tile, c / tile))
                        .map(|r| ((r - nearest_m) / (radius_m - nearest_m)).max(0.0).sqrt())
                        .map(|share| share * samples as f32 - sample as f32)
                        .collect();
                    shares.sort_by(f32::total_cmp);
                    // One in each stratum, up to a common shift. The root of an f32 rounding near 0 is
                    // 3e-4, tripled by the samples.
                    assert!(shares[0] > -1e-3 && *shares.last().unwrap() <= 1.0 + 1e-3);
                    for pair in shares.windows(2) {
                        assert!((pair[1] - pair[0] - 1.0 / cells as f32).abs() < 1e-3);
                    }
                }
                let r = set.distance_m(direction, 0, 0, 0);
                assert!(r > 0.0 && r == set.distance_m(direction, 0, 5 * tile, 7 * tile));
            }
        }
    }

    #[test]
    fn the_seed_alone_decides() {
        let seeded = |seed| {
            DirectionSet::new(&TransferParams { seed, ..TransferParams::default() }).unwrap()
        };
        assert_eq!(seeded(5), seeded(5));
        assert_ne!(seeded(5).directions, seeded(6).directions);
        assert!(seeded(6).directions.iter().all(|w| (w.length() - 1.0).abs() < 1e-6));
        for n in [4, 5, 1024] {
            assert_eq!(set(n).len(), n);
        }
    }
}
