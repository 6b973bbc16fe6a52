//! A shader that counts what it does: the same results, and how often each stretch of straight-line code ran
//! and which sectors of each buffer it touched.
//!
//! One buffer more is bound. It begins with a counter for each stretch; then follow, for each storage buffer,
//! a bit for each sector that was read and one for each that was written.

use super::operations::Costs;
use naga::valid::{Capabilities, FunctionInfo, ValidationFlags, Validator};
use naga::{
    AddressSpace, Arena, ArraySize, AtomicFunction, BinaryOperator, Block, Expression, Function,
    GlobalVariable, Handle, Literal, Module, Range, ResourceBinding, Scalar, ScalarKind, Span,
    Statement, StorageAccess, Type, TypeInner,
};
use std::collections::HashMap;

/// What a GPU's memory moves at least, bytes.
pub const SECTOR_BYTES: u32 = 32;
/// Counters of stretches.
pub const MOST_STRETCHES: usize = 1024;
/// Of a buffer of 128 MiB, the largest that is bound.
pub const WORDS_OF_BITS: usize = (128 << 20) / SECTOR_BYTES as usize / 32;

/// What one run through a stretch costs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    pub float_operations: u64,
    pub other_operations: u64,
    /// Bytes asked for, of storage buffers and textures.
    pub loaded: u64,
    pub stored: u64,
    pub texture_loads: u64,
    pub atomics: u64,
}

/// How the counting buffer is read.
#[derive(Clone, Debug, Default)]
pub struct Counted {
    /// The first is that of the entry point: as many runs as invocations.
    pub stretches: Vec<Cost>,
    /// Storage buffers, each with bits of reads and bits of writes.
    pub buffers: usize,
}

impl Counted {
    /// Of the counting buffer that are used.
    pub fn words(&self) -> usize {
        MOST_STRETCHES + 2 * self.buffers * WORDS_OF_BITS
    }
}

/// The shader that counts, whose last binding is the counting buffer. `module` computes.
pub fn instrument(module: &Module) -> Result<(Module, Counted), String> {
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(module)
        .map_err(|e| e.as_inner().to_string())?;
    let mut out = module.clone();
    let counts = add_counting_buffer(&mut out);
    let storage = module.global_variables.iter().filter(|(_, v)| is_storage(v));
    let slots: HashMap<_, _> = storage.map(|(handle, _)| handle).zip(0..).collect();
    let mut stretches = Vec::new();
    let mut rewrite = |function: &Function, info: &FunctionInfo| {
        let costs = Costs { module, function, info };
        Rewriter::rewrite(costs, counts, &slots, &mut stretches)
    };
    // first, so that its first stretch has number 0
    for (i, entry) in module.entry_points.iter().enumerate() {
        out.entry_points[i].function = rewrite(&entry.function, info.get_entry_point(i));
    }
    for (handle, function) in module.functions.iter() {
        *out.functions.get_mut(handle) = rewrite(function, &info[handle]);
    }
    if stretches.len() > MOST_STRETCHES {
        return Err(format!(
            "{} stretches of code, {MOST_STRETCHES} can be counted",
            stretches.len()
        ));
    }
    Ok((out, Counted { stretches, buffers: slots.len() }))
}

fn is_storage(variable: &GlobalVariable) -> bool {
    matches!(variable.space, AddressSpace::Storage { .. })
}

fn add_counting_buffer(module: &mut Module) -> Handle<GlobalVariable> {
    let unnamed = |inner| Type { name: None, inner };
    let atomic = module.types.insert(unnamed(TypeInner::Atomic(Scalar::U32)), Span::UNDEFINED);
    let array = TypeInner::Array { base: atomic, size: ArraySize::Dynamic, stride: 4 };
    let ty = module.types.insert(unnamed(array), Span::UNDEFINED);
    let bound = module.global_variables.iter().filter(|(_, v)| v.binding.is_some()).count() as u32;
    let variable = GlobalVariable {
        name: Some("counting_buffer".to_owned()),
        space: AddressSpace::Storage { access: StorageAccess::LOAD | StorageAccess::STORE },
        binding: Some(ResourceBinding { group: 0, binding: bound }),
        ty,
        init: None,
        memory_decorations: naga::MemoryDecorations::empty(),
    };
    module.global_variables.append(variable, Span::UNDEFINED)
}

/// A place in a storage buffer: bytes from its start, and bytes that are there.
struct Place {
    buffer: u32,
    constant: u32,
    /// Indices, each times bytes.
    scaled: Vec<(Handle<Expression>, u32)>,
    bytes: u32,
}

struct Rewriter<'a> {
    costs: Costs<'a>,
    slots: &'a HashMap<Handle<GlobalVariable>, u32>,
    expressions: Arena<Expression>,
    counting_buffer: Handle<Expression>,
    stretches: &'a mut Vec<Cost>,
}

/// A stretch in the making.
struct Stretch {
    /// Where its statements begin.
    at: usize,
    number: usize,
}

impl<'a> Rewriter<'a> {
    fn rewrite(
        costs: Costs<'a>,
        counts: Handle<GlobalVariable>,
        slots: &'a HashMap<Handle<GlobalVariable>, u32>,
        stretches: &'a mut Vec<Cost>,
    ) -> Function {
        let mut function = costs.function.clone();
        let mut expressions = std::mem::take(&mut function.expressions);
        let counting_buffer =
            expressions.append(Expression::GlobalVariable(counts), Span::UNDEFINED);
        let body = std::mem::take(&mut function.body);
        let mut rewriter = Self { costs, slots, expressions, counting_buffer, stretches };
        function.body = rewriter.block(&body);
        function.expressions = rewriter.expressions;
        function
    }

    fn block(&mut self, block: &Block) -> Block {
        let mut out = Vec::with_capacity(2 * block.len());
        let mut stretch = self.begin(&out);
        for statement in block.iter() {
            self.statement(statement, stretch.number, &mut out);
            if diverts(statement) {
                self.end(stretch, &mut out);
                stretch = self.begin(&out);
            }
        }
        self.end(stretch, &mut out);
        Block::from_vec(out)
    }

    fn begin(&mut self, out: &[Statement]) -> Stretch {
        self.stretches.push(Cost::default());
        Stretch { at: out.len(), number: self.stretches.len() - 1 }
    }

    /// Has the stretch counted, where it costs anything.
    fn end(&mut self, stretch: Stretch, out: &mut Vec<Statement>) {
        let Stretch { at, number } = stretch;
        if number != 0 && self.stretches[number] == Cost::default() {
            return;
        }
        let one = self.literal(1);
        let pointer = self.append(Expression::AccessIndex {
            base: self.counting_buffer,
            index: number.min(MOST_STRETCHES - 1) as u32,
        });
        let count = [
            Statement::Emit(Range::new_from_bounds(pointer, pointer)),
            Statement::Atomic { pointer, fun: AtomicFunction::Add, value: one, result: None },
        ];
        out.splice(at..at, count);
    }

    fn statement(&mut self, statement: &Statement, stretch: usize, out: &mut Vec<Statement>) {
        let before = out.len();
        match statement {
            Statement::Emit(range) => {
                out.push(statement.clone());
                range.clone().for_each(|e| self.expression(e, stretch, out));
            }
            Statement::Block(block) => out.push(Statement::Block(self.block(block))),
            Statement::If { condition, accept, reject } => {
                let (accept, reject) = (self.block(accept), self.block(reject));
                out.push(Statement::If { condition: *condition, accept, reject });
            }
            Statement::Switch { selector, cases } => {
                let mut cases = cases.clone();
                cases.iter_mut().for_each(|case| case.body = self.block(&case.body));
                out.push(Statement::Switch { selector: *selector, cases });
            }
            Statement::Loop { body, continuing, break_if } => {
                let (body, continuing) = (self.block(body), self.block(continuing));
                out.push(Statement::Loop { body, continuing, break_if: *break_if });
            }
            Statement::Store { pointer, .. } => {
                if let Some(place) = self.place(*pointer) {
                    self.stretches[stretch].stored += u64::from(place.bytes);
                    self.mark(&place, true, out);
                }
                out.push(statement.clone());
            }
            Statement::Atomic { pointer, .. } => {
                if let Some(place) = self.place(*pointer) {
                    self.stretches[stretch].atomics += 1;
                    self.mark(&place, false, out);
                    self.mark(&place, true, out);
                }
                out.push(statement.clone());
            }
            _ => out.push(statement.clone()),
        }
        debug_assert!(out.len() > before);
    }

    fn expression(&mut self, e: Handle<Expression>, stretch: usize, out: &mut Vec<Statement>) {
        let operations = self.costs.of(e);
        let cost = &mut self.stretches[stretch];
        match operations.is_float {
            true => cost.float_operations += operations.count,
            false => cost.other_operations += operations.count,
        }
        match self.costs.function.expressions[e] {
            Expression::Load { pointer } => {
                if let Some(place) = self.place(pointer) {
                    self.stretches[stretch].loaded += u64::from(place.bytes);
                    self.mark(&place, false, out);
                }
            }
            Expression::ImageLoad { .. } => cost.texture_loads += 1,
            _ => {}
        }
    }

    /// Where a pointer leads, if into a storage buffer.
    fn place(&self, pointer: Handle<Expression>) -> Option<Place> {
        enum Step {
            Constant(u32),
            Index(Handle<Expression>),
        }
        let mut steps = Vec::new();
        let mut at = pointer;
        let variable = loop {
            match self.costs.function.expressions[at] {
                Expression::Access { base, index } => {
                    steps.push(Step::Index(index));
                    at = base;
                }
                Expression::AccessIndex { base, index } => {
                    steps.push(Step::Constant(index));
                    at = base;
                }
                Expression::GlobalVariable(variable) => break variable,
                _ => return None,
            }
        };
        let module = self.costs.module;
        let mut place = Place {
            buffer: *self.slots.get(&variable)?,
            constant: 0,
            scaled: Vec::new(),
            bytes: 0,
        };
        let mut ty = Some(module.global_variables[variable].ty);
        for step in steps.iter().rev() {
            let stride = match (&module.types[ty?].inner, step) {
                (TypeInner::Struct { members, .. }, Step::Constant(member)) => {
                    let member = &members[*member as usize];
                    place.constant += member.offset;
                    ty = Some(member.ty);
                    continue;
                }
                (TypeInner::Array { base, stride, .. }, _) => {
                    ty = Some(*base);
                    *stride
                }
                (TypeInner::Vector { scalar, .. }, _) => {
                    ty = None;
                    place.bytes = u32::from(scalar.width);
                    u32::from(scalar.width)
                }
                (TypeInner::Matrix { columns, .. }, _) => {
                    let bytes = module.types[ty?].inner.size(module.to_ctx());
                    ty = None;
                    place.bytes = bytes / *columns as u32;
                    place.bytes
                }
                _ => return None,
            };
            match *step {
                Step::Constant(index) => place.constant += index * stride,
                Step::Index(index) => place.scaled.push((index, stride)),
            }
        }
        if let Some(ty) = ty {
            place.bytes = module.types[ty].inner.size(module.to_ctx());
        }
        Some(place)
    }

    /// Sets the bits of the sectors that a place is in.
    fn mark(&mut self, place: &Place, is_write: bool, out: &mut Vec<Statement>) {
        let region = 2 * place.buffer as usize + usize::from(is_write);
        let first_word = self.literal((MOST_STRETCHES + region * WORDS_OF_BITS) as u32);
        let [one, low_bits] = [1, 31].map(|n| self.literal(n));
        let per_word = self.literal(5);
        let per_sector = self.literal(SECTOR_BYTES.trailing_zeros());
        let strides: Vec<_> = place.scaled.iter().map(|&(_, n)| self.literal(n)).collect();
        let offsets: Vec<_> =
            offsets(place.bytes).map(|bytes| self.literal(place.constant + bytes)).collect();

        let first = self.expressions.len();
        let mut atomics = Vec::new();
        for offset in offsets {
            let mut bytes = offset;
            for (&(index, _), &stride) in place.scaled.iter().zip(&strides) {
                let kind = self.costs.type_of(index).scalar_kind();
                let index = match kind {
                    Some(ScalarKind::Uint) => index,
                    _ => self.append(Expression::As {
                        expr: index,
                        kind: ScalarKind::Uint,
                        convert: Some(4),
                    }),
                };
                let scaled = self.binary(BinaryOperator::Multiply, index, stride);
                bytes = self.binary(BinaryOperator::Add, bytes, scaled);
            }
            let sector = self.binary(BinaryOperator::ShiftRight, bytes, per_sector);
            let word = self.binary(BinaryOperator::ShiftRight, sector, per_word);
            let word = self.binary(BinaryOperator::Add, word, first_word);
            let bit = self.binary(BinaryOperator::And, sector, low_bits);
            let value = self.binary(BinaryOperator::ShiftLeft, one, bit);
            let pointer =
                self.append(Expression::Access { base: self.counting_buffer, index: word });
            let fun = AtomicFunction::InclusiveOr;
            atomics.push(Statement::Atomic { pointer, fun, value, result: None });
        }
        out.push(Statement::Emit(self.expressions.range_from(first)));
        out.append(&mut atomics);
    }

    fn literal(&mut self, value: u32) -> Handle<Expression> {
        self.append(Expression::Literal(Literal::U32(value)))
    }

    fn binary(
        &mut self,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
    ) -> Handle<Expression> {
        self.append(Expression::Binary { op, left, right })
    }

    fn append(&mut self, expression: Expression) -> Handle<Expression> {
        self.expressions.append(expression, Span::UNDEFINED)
    }
}

/// One byte of each sector that a value may lie in: vectors are aligned and lie in one, structs may not.
fn offsets(bytes: u32) -> impl Iterator<Item = u32> {
    let last = (bytes > 16).then_some(bytes.saturating_sub(4));
    (0..bytes.max(1)).step_by(SECTOR_BYTES as usize).chain(last)
}

/// Whether what follows a statement may be left out though it ran.
fn diverts(statement: &Statement) -> bool {
    let any = |block: &Block| block.iter().any(diverts);
    match statement {
        Statement::Return { .. } | Statement::Kill | Statement::Break | Statement::Continue => true,
        Statement::Block(block) => any(block),
        Statement::If { accept, reject, .. } => any(accept) || any(reject),
        Statement::Switch { cases, .. } => cases.iter().any(|case| any(&case.body)),
        Statement::Loop { body, continuing, .. } => returns(body) || returns(continuing),
        _ => false,
    }
}

fn returns(block: &Block) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Return { .. } | Statement::Kill => true,
        Statement::Block(block) => returns(block),
        Statement::If { accept, reject, .. } => returns(accept) || returns(reject),
        Statement::Switch { cases, .. } => cases.iter().any(|case| returns(&case.body)),
        Statement::Loop { body, continuing, .. } => returns(body) || returns(continuing),
        _ => false,
    })
}
