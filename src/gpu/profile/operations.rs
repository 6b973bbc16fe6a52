//! What one expression of a shader costs.
//!
//! Counted are additions, multiplications, divisions, comparisons, selections, conversions and bit operations,
//! one for each lane; a fused multiplication and addition is two, as in the peak rates of data sheets; a root, an
//! exponential or another function of the hardware is one. Free are what a GPU has no instruction for:
//! negations, swizzles, bit casts, and the arithmetic of addresses.

use naga::valid::FunctionInfo;
use naga::{
    BinaryOperator, Expression, Function, Handle, MathFunction, Module, ScalarKind, TypeInner,
    UnaryOperator,
};

/// Operations of one expression, and whether they are in floating point.
pub struct Operations {
    pub count: u64,
    pub is_float: bool,
}

pub struct Costs<'m> {
    pub module: &'m Module,
    pub function: &'m Function,
    pub info: &'m FunctionInfo,
}

impl Costs<'_> {
    pub fn type_of(&self, expression: Handle<Expression>) -> &TypeInner {
        self.info[expression].ty.inner_with(&self.module.types)
    }

    pub fn of(&self, handle: Handle<Expression>) -> Operations {
        let own = lanes(self.type_of(handle));
        let (count, decides) = match self.function.expressions[handle] {
            Expression::Binary { op, left, right } => (self.binary(op, left, right, own), left),
            Expression::Unary { op: UnaryOperator::BitwiseNot, expr } => (own, expr),
            Expression::Select { accept, .. } => (own, accept),
            Expression::Relational { argument, .. } => (lanes(self.type_of(argument)), argument),
            Expression::As { expr, convert: Some(_), .. } => (own, expr),
            Expression::Math { fun, arg, .. } => (math(fun, lanes(self.type_of(arg)), own), arg),
            _ => (0, handle),
        };
        let is_float = self.type_of(decides).scalar_kind() == Some(ScalarKind::Float);
        Operations { count, is_float }
    }

    fn binary(
        &self,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
        own: u64,
    ) -> u64 {
        let inner = match (op, self.type_of(left), self.type_of(right)) {
            (BinaryOperator::Multiply, &TypeInner::Matrix { columns, .. }, right)
                if right.scalar().is_none() || !matches!(right, TypeInner::Scalar(_)) =>
            {
                columns as u64
            }
            (
                BinaryOperator::Multiply,
                TypeInner::Vector { size, .. },
                TypeInner::Matrix { .. },
            ) => *size as u64,
            _ => 1,
        };
        // products and their sum
        own * (2 * inner - 1)
    }
}

/// Of functions, by lanes of the argument and of the result.
fn math(fun: MathFunction, argument: u64, own: u64) -> u64 {
    use MathFunction::*;
    match fun {
        Dot => 2 * argument - 1,
        Length => 2 * argument,
        Distance => 3 * argument,
        Normalize => 3 * argument,
        Cross => 9,
        Reflect => 4 * argument,
        Clamp | Fma => 2 * own,
        Mix => 3 * own,
        SmoothStep => 8 * own,
        Transpose => 0,
        _ => own,
    }
}

fn lanes(ty: &TypeInner) -> u64 {
    match *ty {
        TypeInner::Vector { size, .. } => size as u64,
        TypeInner::Matrix { columns, rows, .. } => columns as u64 * rows as u64,
        _ => 1,
    }
}
