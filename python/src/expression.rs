//! The numbers with which a user's model is traced.
//!
//! A function of Python is called once with [`Expression`]s in place of numbers; what it computes with
//! them is the graph of the model. `NumPy`'s functions call the methods below on arrays of objects.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use horizon_model::expression::{Binary, Graph, Id, Unary, Variable};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// The graph of one model while it is traced.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tracer(Arc<Mutex<Graph>>);

/// A number of a model that is being traced: `+ - * / **`, and `NumPy`'s functions.
#[pyclass(module = "tello_ctl", frozen, from_py_object)]
#[derive(Debug, Clone)]
pub(crate) struct Expression {
    tracer: Tracer,
    id: Id,
}

/// Second operand of an expression: another expression, or a number.
#[derive(FromPyObject)]
pub(crate) enum Operand {
    /// An expression.
    Expression(Expression),
    /// A constant.
    Number(f64),
}

impl Tracer {
    /// The graph.
    pub(crate) fn graph(&self) -> MutexGuard<'_, Graph> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The variables of `count` rows.
    pub(crate) fn variables(&self, count: usize, of: fn(usize) -> Variable) -> Vec<Expression> {
        let mut graph = self.graph();
        (0..count)
            .map(|row| Expression { tracer: self.clone(), id: graph.variable(of(row)) })
            .collect()
    }

    /// One variable.
    pub(crate) fn variable(&self, variable: Variable) -> Expression {
        Expression { tracer: self.clone(), id: self.graph().variable(variable) }
    }

    /// The id of an operand in this graph.
    ///
    /// # Errors
    /// An expression of another graph.
    pub(crate) fn id(&self, operand: &Operand) -> PyResult<Id> {
        match operand {
            Operand::Number(value) => Ok(self.graph().constant(*value)),
            Operand::Expression(other) if Arc::ptr_eq(&self.0, &other.tracer.0) => Ok(other.id),
            Operand::Expression(_) => {
                let message = "a number of another model: use only the arguments of the function";
                Err(PyTypeError::new_err(message))
            }
        }
    }

    /// An operand as an expression of this graph.
    fn lift(&self, operand: &Operand) -> PyResult<Expression> {
        Ok(Expression { tracer: self.clone(), id: self.id(operand)? })
    }
}

impl Expression {
    fn unary(&self, function: Unary) -> Self {
        Self { tracer: self.tracer.clone(), id: self.tracer.graph().unary(function, self.id) }
    }

    fn binary(&self, function: Binary, other: &Operand, is_reversed: bool) -> PyResult<Self> {
        let other = self.tracer.id(other)?;
        let (a, b) = if is_reversed { (other, self.id) } else { (self.id, other) };
        let id = self.tracer.graph().binary(function, a, b);
        Ok(Self { tracer: self.tracer.clone(), id })
    }
}

/// Refuses the third number of Python's `pow`, of which floats know nothing either.
fn without_modulo(has_modulo: bool) -> PyResult<()> {
    if has_modulo {
        Err(refusal("take a power modulo a number", "write pow(x, y)"))
    } else {
        Ok(())
    }
}

/// Error of an operation that a traced model does not have, with a replacement.
fn refusal(what: &str, instead: &str) -> PyErr {
    PyTypeError::new_err(format!("a traced model cannot {what}: {instead}"))
}

/// Description of `>=` and `<=`, which `NumPy`'s `minimum`, `maximum` and `clip` call.
const OR_EQUAL: &str = "compare by >= or <=, as numpy's minimum, maximum and clip do";

#[pymethods]
#[expect(
    clippy::needless_pass_by_value,
    clippy::unused_self,
    reason = "what Python's protocols want"
)]
impl Expression {
    fn __add__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Add, &other, false)
    }
    fn __radd__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Add, &other, true)
    }
    fn __sub__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Sub, &other, false)
    }
    fn __rsub__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Sub, &other, true)
    }
    fn __mul__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Mul, &other, false)
    }
    fn __rmul__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Mul, &other, true)
    }
    fn __truediv__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Div, &other, false)
    }
    fn __rtruediv__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Div, &other, true)
    }
    fn __pow__(&self, other: Operand, modulo: Option<Py<PyAny>>) -> PyResult<Self> {
        without_modulo(modulo.is_some())?;
        self.binary(Binary::Pow, &other, false)
    }
    fn __rpow__(&self, other: Operand, modulo: Option<Py<PyAny>>) -> PyResult<Self> {
        without_modulo(modulo.is_some())?;
        self.binary(Binary::Pow, &other, true)
    }
    fn __neg__(&self) -> Self {
        self.unary(Unary::Neg)
    }
    fn __pos__(&self) -> Self {
        self.clone()
    }
    fn __abs__(&self) -> Self {
        self.unary(Unary::Abs)
    }
    fn sin(&self) -> Self {
        self.unary(Unary::Sin)
    }
    fn cos(&self) -> Self {
        self.unary(Unary::Cos)
    }
    fn tan(&self) -> Self {
        self.unary(Unary::Tan)
    }
    fn arcsin(&self) -> Self {
        self.unary(Unary::Asin)
    }
    fn arccos(&self) -> Self {
        self.unary(Unary::Acos)
    }
    fn arctan(&self) -> Self {
        self.unary(Unary::Atan)
    }
    fn sinh(&self) -> Self {
        self.unary(Unary::Sinh)
    }
    fn cosh(&self) -> Self {
        self.unary(Unary::Cosh)
    }
    fn tanh(&self) -> Self {
        self.unary(Unary::Tanh)
    }
    fn exp(&self) -> Self {
        self.unary(Unary::Exp)
    }
    fn log(&self) -> Self {
        self.unary(Unary::Ln)
    }
    fn sqrt(&self) -> Self {
        self.unary(Unary::Sqrt)
    }
    fn sign(&self) -> Self {
        self.unary(Unary::Sign)
    }
    fn square(&self) -> PyResult<Self> {
        self.binary(Binary::Mul, &Operand::Expression(self.clone()), false)
    }
    fn arctan2(&self, x: Operand) -> PyResult<Self> {
        self.binary(Binary::Atan2, &x, false)
    }
    fn hypot(&self, other: Operand) -> PyResult<Self> {
        let other = self.tracer.lift(&other)?.square()?;
        Ok(self.square()?.binary(Binary::Add, &Operand::Expression(other), false)?.sqrt())
    }
    /// The smaller of two numbers.
    fn minimum(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Min, &other, false)
    }
    /// The larger of two numbers.
    fn maximum(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Max, &other, false)
    }
    fn __bool__(&self) -> PyResult<bool> {
        Err(refusal(
            "branch on its arguments",
            "use tello_ctl.select(condition, a, b), .minimum, .maximum or .sign",
        ))
    }
    fn __float__(&self) -> PyResult<f64> {
        Err(refusal(
            "turn an argument into a float",
            "use numpy's functions instead of those of math",
        ))
    }
    fn __ge__(&self, _other: Py<PyAny>) -> PyResult<Self> {
        Err(refusal(OR_EQUAL, "use < or >, .minimum or .maximum"))
    }
    fn __le__(&self, _other: Py<PyAny>) -> PyResult<Self> {
        Err(refusal(OR_EQUAL, "use < or >, .minimum or .maximum"))
    }
    fn __eq__(&self, _other: Py<PyAny>) -> PyResult<Self> {
        Err(refusal("ask whether its arguments are equal", "use tello_ctl.select with < or >"))
    }
    fn __ne__(&self, _other: Py<PyAny>) -> PyResult<Self> {
        Err(refusal("ask whether its arguments are equal", "use tello_ctl.select with < or >"))
    }
    fn __gt__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Above, &other, false)
    }
    fn __lt__(&self, other: Operand) -> PyResult<Self> {
        self.binary(Binary::Above, &other, true)
    }
    fn __repr__(&self) -> String {
        "<a number of a traced model>".to_owned()
    }
}

/// `a` where `condition` holds, else `b`, for traced models; `condition` is a comparison with `<` or `>`. What is not
/// taken may be infinite or NaN.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn select(condition: &Expression, a: Operand, b: Operand) -> PyResult<Expression> {
    let tracer = &condition.tracer;
    let (a, b) = (tracer.id(&a)?, tracer.id(&b)?);
    Ok(Expression { tracer: tracer.clone(), id: tracer.graph().select(condition.id, a, b) })
}
