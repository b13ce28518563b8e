//! One vector per input and one per state of a horizon.

use horizon_model::Vector;

/// `u_0 .. u_{N-1}` and `s_1 .. s_N`, or anything else of that shape: a step, a gradient.
///
/// The initial state is given and therefore not part of it: `s[k]` belongs to `s_{k+1}`.
#[derive(Debug, Clone, PartialEq)]
pub struct Horizon<const NS: usize, const NU: usize> {
    /// By step, `u[k]` belongs to `u_k`. Unit of each row
    pub u: Vec<Vector<NU>>,
    /// By step, `s[k]` belongs to `s_{k+1}`. Unit of each row
    pub s: Vec<Vector<NS>>,
}

impl<const NS: usize, const NU: usize> Horizon<NS, NU> {
    /// Zeros for `steps` inputs and as many states. The only allocation.
    pub fn zeros(steps: usize) -> Self {
        Self { u: vec![Vector::zeros(); steps], s: vec![Vector::zeros(); steps] }
    }

    /// Number of steps `N`.
    pub fn steps(&self) -> usize {
        self.u.len()
    }
}
