//! Check of the functions of a model that must agree with others to rounding: no derivative tells of these.

use super::{Check, Point, driven_by_period, linearized_by_period};
use crate::Vector;
use crate::model::Model;

/// Names of the functions that are checked here, as a [`Gap`](super::Gap) shows them.
pub(super) const NAMES: [&str; 4] = ["prepared", "core", "input_for", "at_rest"];

/// Checks
///
/// - `prepared`: `m = prepared(p, dt)` has the step and the linearizations of the model, and its step over `2 dt`;
/// - `core`: `core().step(s, effect(u, p), p) = step(s, u, p)`;
/// - `input_for`: `effect(input_for(e, p), p) = e` for `e = effect(u, p)`, also where more than one input has this
///   effect;
/// - `at_rest`: `observe(at_rest(o)) = o` for `o = observe(s)`.
pub(super) fn check<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    check: &mut Check,
    model: &M,
    at: &Point<NS, NU, NP>,
) where
    M: Model<NS, NU, NO, NP>,
{
    let [prepared, core, input_for, at_rest] = NAMES;
    check_prepared(check, prepared, model, at);
    let Point { s, u, p, dt_s } = at;
    let s_next = model.step(s, u, p, *dt_s) / *dt_s;
    let effect = model.effect(u, p);
    let by_core = model.core().step(s, &effect, p, *dt_s) / *dt_s;
    check.compare(core, (&by_core, &s_next), (&M::STATE, &[]));
    let again = model.effect(&model.input_for(&effect, p), p);
    check.compare(input_for, (&again, &effect), (&M::INPUT, &[]));
    let o: Vector<NO> = model.observe(s);
    let again = model.observe(&model.at_rest(&o));
    check.compare(at_rest, (&again, &o), (&M::OBSERVATION, &[]));
}

fn check_prepared<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    check: &mut Check,
    name: &'static str,
    model: &M,
    at: &Point<NS, NU, NP>,
) where
    M: Model<NS, NU, NO, NP>,
{
    let Point { s, u, p, dt_s } = at;
    let (states, inputs, parameters) = (&M::STATE[..], &M::INPUT[..], &M::PARAMETER[..]);
    let prepared = model.prepared(p, *dt_s);
    for period_s in [*dt_s, 2.0 * dt_s] {
        let [given, own] = [&prepared, model].map(|model| model.step(s, u, p, period_s) / period_s);
        check.compare(name, (&given, &own), (states, &[]));
    }
    let [given, own] = [&prepared, model].map(|model| linearized_by_period(model, at));
    check.linearized(name, (&given, &own), (states, parameters));
    let [given, own] = [&prepared, model].map(|model| driven_by_period(model, at));
    check.linearized_by_input(name, (&given, &own), (states, inputs));
}

#[cfg(test)]
mod tests;
