//! A geometry buffer, made ready for the look-up of sample points, with and without virtual surfaces.

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use super::batch::Batch;
use super::directions::{DirectionSet, LANES};
use super::limits::{DepthLimits, Insertion};
use super::samples::{NOT_HIDDEN, Nearest, Place, Points, SampleView, Step};
use crate::geometry::GBuffer;
use crate::math::View;

/// What hides samples in a view.
///
/// Most samples lie in front of everything that is seen near them. So the samples of a batch are
/// first tried together: one look-up in a pyramid of nearest depths tells for one sample of all 16
/// points whether any can be hidden. Bounds are made with the arithmetic of the samples themselves,
/// and rounding keeps the order of numbers, so nothing that is hidden is ever missed.
#[derive(Debug, Default)]
pub(super) struct Occluder {
    pub view: SampleView,
    real: DepthLimits,
    insertion: Insertion,
    shows_virtual: bool,
}

/// What a batch knows of its samples' visibility, by direction.
pub(super) struct Found<'a> {
    /// max(0, n.w)
    pub cosine: &'a [[f32; LANES]],
    /// Largest t.w of a surface that hides a sample.
    pub best: &'a mut [[f32; LANES]],
    /// The same without virtual surfaces; filled where asked for.
    pub before: &'a mut [[f32; LANES]],
    /// Which surface `best` was, as a code; filled where asked for.
    pub hit: &'a mut [[u32; LANES]],
}

/// What is done with samples that may be hidden. A trait, as closures cannot be asked to become
/// part of a kernel for particular instructions.
trait Visit: Nearest {
    fn visit<const PERSPECTIVE: bool>(
        &mut self,
        view: &SampleView,
        points: &Points,
        direction: usize,
        step: &Step,
        place: &Place,
    );
}

/// Keeps the real surface that fits the direction best.
struct FitReal<'a> {
    limits: &'a DepthLimits,
    found: Found<'a>,
}

impl Nearest for FitReal<'_> {
    #[inline(always)]
    unsafe fn nearest(&self, first: [i32; 2], last: [i32; 2]) -> f32 {
        // SAFETY: passed on
        unsafe { self.limits.nearest(first, last) }
    }
}

impl Visit for FitReal<'_> {
    #[inline(always)]
    fn visit<const PERSPECTIVE: bool>(
        &mut self,
        view: &SampleView,
        points: &Points,
        direction: usize,
        step: &Step,
        place: &Place,
    ) {
        let limit = gathered(&self.limits.hidden_beyond_m, place);
        if !any_beyond(place, &limit) {
            return;
        }
        let above = &self.found.cosine[direction];
        let cosine = view.fit::<PERSPECTIVE>(points, step, above, place, &limit);
        keep_larger(&mut self.found.best[direction], &cosine);
    }
}

/// Keeps which surface fits the direction best with virtual surfaces, and, with `COMPARE`, how well one
/// does without them.
struct FitMerged<'a, const COMPARE: bool> {
    real: &'a DepthLimits,
    insertion: Option<&'a Insertion>,
    found: Found<'a>,
    first_code: u32,
}

impl<const COMPARE: bool> Nearest for FitMerged<'_, COMPARE> {
    #[inline(always)]
    unsafe fn nearest(&self, first: [i32; 2], last: [i32; 2]) -> f32 {
        // SAFETY: passed on
        let real = unsafe { self.real.nearest(first, last) };
        let Some(insertion) = self.insertion else { return real };
        // SAFETY: passed on
        let changed = unsafe { insertion.nearest(first, last) };
        if changed < real { changed } else { real }
    }
}

impl<const COMPARE: bool> Visit for FitMerged<'_, COMPARE> {
    #[inline(always)]
    fn visit<const PERSPECTIVE: bool>(
        &mut self,
        view: &SampleView,
        points: &Points,
        direction: usize,
        step: &Step,
        place: &Place,
    ) {
        let before = &self.real.hidden_beyond_m;
        let after = self.insertion.map_or(before, |insertion| &insertion.merged_m);
        let limit = gathered(after, place);
        let above = &self.found.cosine[direction];
        let mut cosine = [NOT_HIDDEN; LANES];
        if any_beyond(place, &limit) {
            cosine = view.fit::<PERSPECTIVE>(points, step, above, place, &limit);
            let (best, hit) = (&mut self.found.best[direction], &mut self.found.hit[direction]);
            for i in 0..LANES {
                let better = cosine[i] > best[i];
                best[i] = if better { cosine[i] } else { best[i] };
                hit[i] = if better { self.first_code + place.index[i] as u32 } else { hit[i] };
            }
        }
        if !COMPARE {
            return;
        }
        if self.insertion.is_some() {
            let real_limit = gathered(before, place);
            if differ(&real_limit, &limit) {
                cosine = view.fit::<PERSPECTIVE>(points, step, above, place, &real_limit);
            }
        }
        keep_larger(&mut self.found.before[direction], &cosine);
    }
}

/// Marks directions in which virtual surfaces may have changed anything.
struct Mark<'a> {
    insertion: &'a Insertion,
    marks: &'a mut [bool],
}

impl Nearest for Mark<'_> {
    #[inline(always)]
    unsafe fn nearest(&self, first: [i32; 2], last: [i32; 2]) -> f32 {
        // SAFETY: passed on
        unsafe { self.insertion.nearest(first, last) }
    }
}

impl Visit for Mark<'_> {
    #[inline(always)]
    fn visit<const PERSPECTIVE: bool>(
        &mut self,
        _: &SampleView,
        _: &Points,
        direction: usize,
        _: &Step,
        place: &Place,
    ) {
        self.marks[direction] |= self.insertion.hides_any(place);
    }
}

#[inline(always)]
fn gathered(limits: &[f32], place: &Place) -> [f32; LANES] {
    let mut limit = [0f32; LANES];
    for i in 0..LANES {
        // SAFETY: `locate` stays inside the padded picture, and `each_candidate` asserts its size
        limit[i] = unsafe { *limits.get_unchecked(place.index[i] as usize) };
    }
    limit
}

#[inline(always)]
fn any_beyond(place: &Place, limit: &[f32; LANES]) -> bool {
    let mut any = 0;
    for i in 0..LANES {
        any |= u32::from(place.z[i] > limit[i]);
    }
    any != 0
}

#[inline(always)]
fn differ(a: &[f32; LANES], b: &[f32; LANES]) -> bool {
    let mut any = 0;
    for i in 0..LANES {
        any |= u32::from(a[i] != b[i]);
    }
    any != 0
}

#[inline(always)]
fn keep_larger(best: &mut [f32; LANES], cosine: &[f32; LANES]) {
    for i in 0..LANES {
        best[i] = if cosine[i] > best[i] { cosine[i] } else { best[i] };
    }
}

impl Occluder {
    /// Shows a buffer without virtual surfaces.
    pub fn prepare(&mut self, buffer: &GBuffer, main: &View, set: &DirectionSet, bias_m: f32) {
        self.view.prepare(&buffer.view, main, set, bias_m);
        self.real.prepare(buffer, bias_m);
        self.shows_virtual = false;
    }

    /// Adds virtual surfaces; `merged` must differ from the buffer of [`Self::prepare`] in these alone.
    pub fn insert(&mut self, merged: &GBuffer, bias_m: f32) {
        self.shows_virtual = self.insertion.prepare(&self.real, merged, bias_m);
    }

    pub fn shows_virtual(&self) -> bool {
        self.shows_virtual
    }

    fn insertion(&self) -> Option<&Insertion> {
        self.shows_virtual.then_some(&self.insertion)
    }

    /// Which pixel of the buffer a padded index stands for.
    pub fn pixel(&self, padded: usize) -> (usize, usize) {
        let stride = self.view.stride();
        (padded % stride - 1, padded / stride - 1)
    }

    /// Number of padded pixels.
    pub fn padded_len(&self) -> usize {
        self.real.hidden_beyond_m.len()
    }

    /// Tries the samples in the slots of `wanted`, a bit a slot. Where a real surface that hides one fits
    /// its direction better than the best so far, it becomes the best.
    #[inline(always)]
    pub fn cast_real(&self, batch: &Batch, set: &DirectionSet, wanted: &[u16], found: Found) {
        self.each_candidate(batch, set, wanted, &mut FitReal { limits: &self.real, found });
    }

    /// As [`Self::cast_real`] with virtual surfaces; `hit` takes `first_code` plus the padded pixel
    /// index. With `COMPARE`, `before` becomes what `best` is without virtual surfaces.
    #[inline(always)]
    pub fn cast_merged<const COMPARE: bool>(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        found: Found,
        first_code: u32,
    ) {
        let (real, insertion) = (&self.real, self.insertion());
        let mut visitor = FitMerged::<COMPARE> { real, insertion, found, first_code };
        self.each_candidate(batch, set, wanted, &mut visitor);
    }

    /// Marks the directions in which any sample is behind a virtual surface, or was behind what
    /// that covers.
    #[inline(always)]
    pub fn mark_changed(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        marks: &mut [bool],
    ) {
        let Some(insertion) = self.insertion() else { return };
        let reach = if self.view.perspective {
            self.view.reach::<true>(&self.view.points::<true>(batch), set.farthest_m)
        } else {
            self.view.reach::<false>(&self.view.points::<false>(batch), set.farthest_m)
        };
        if reach.is_none_or(|(low, high)| insertion.meets(&low, &high)) {
            self.each_candidate(batch, set, wanted, &mut Mark { insertion, marks });
        }
    }

    #[inline(always)]
    fn each_candidate(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        visitor: &mut impl Visit,
    ) {
        if self.view.perspective {
            self.each_candidate_as::<true>(batch, set, wanted, visitor);
        } else {
            self.each_candidate_as::<false>(batch, set, wanted, visitor);
        }
    }

    /// Shows the visitor each wanted sample that may be hidden in some lane.
    #[inline(always)]
    fn each_candidate_as<const PERSPECTIVE: bool>(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        visitor: &mut impl Visit,
    ) {
        let view = &self.view;
        let padded = view.stride() * (view.height + 2);
        assert_eq!(self.real.hidden_beyond_m.len(), padded);
        assert!(self.insertion().is_none_or(|insertion| insertion.merged_m.len() == padded));
        let points = view.points::<PERSPECTIVE>(batch);
        let distances = set.distances(batch.cell.0, batch.cell.1);
        for (c, (&wanted, r)) in wanted.iter().zip(distances).enumerate() {
            if wanted == 0 {
                continue;
            }
            let change = view.change::<PERSPECTIVE>(&points, &view.slopes[c], r);
            let mut left = wanted & view.candidates::<PERSPECTIVE>(&points, &change, visitor);
            while left != 0 {
                let s = left.trailing_zeros() as usize;
                left &= left - 1;
                let direction = set.direction_of(c * LANES + s);
                let change = [change[0][s], change[1][s], change[2][s]];
                let step = Step { w: view.directions[direction], r: r[s], change };
                let place = view.locate::<PERSPECTIVE>(&points, &step);
                visitor.visit::<PERSPECTIVE>(view, &points, direction, &step, &place);
            }
        }
    }
}
