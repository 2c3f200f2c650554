//! Laws, observers and task maps of any kind behind one type each: a file chooses at run time what the compiler would else multiply.
//!
//! Numbers are shared, states are boxed once when the controller comes to rest: a step allocates nothing.

use alloc::boxed::Box;
use alloc::sync::Arc;
use core::fmt;

use crate::controller::{Command, Controller, Input};
use crate::force::task::{Task, TaskMap};
use crate::observer::{Sample, VelocityObserver};

/// A state with the numbers it belongs to.
struct Pair<T, S> {
    numbers: Arc<T>,
    state: S,
}

/// State of an [`AnyLaw`].
pub(super) trait LawState<const N: usize>: Send {
    fn step(&mut self, input: &Input<N>) -> Command<N>;
}

impl<const N: usize, C: Controller<N> + Send + Sync> LawState<N> for Pair<C, C::State>
where
    C::State: Send,
{
    fn step(&mut self, input: &Input<N>) -> Command<N> {
        self.numbers.step(&mut self.state, input)
    }
}

/// What makes a state of `X`.
type Fresh<X> = Box<dyn Fn() -> Box<X> + Send + Sync>;

/// Numbers as they are printed: all of them, which is what a seal of them needs.
type Shown = Arc<dyn fmt::Debug + Send + Sync>;

/// A controller of any law.
pub(super) struct AnyLaw<const N: usize> {
    fresh: Fresh<dyn LawState<N>>,
    shown: Shown,
}

impl<const N: usize> fmt::Debug for AnyLaw<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.shown.fmt(f)
    }
}

impl<const N: usize> AnyLaw<N> {
    pub(super) fn new<C: Controller<N> + fmt::Debug + Send + Sync + 'static>(law: C) -> Self
    where
        C::State: Send + 'static,
    {
        let numbers = Arc::new(law);
        let shown: Shown = numbers.clone();
        Self { shown, fresh: Box::new(move || Box::new(Pair { state: numbers.at_rest(), numbers: Arc::clone(&numbers) })) }
    }
}

impl<const N: usize> Controller<N> for AnyLaw<N> {
    type State = Box<dyn LawState<N>>;

    fn at_rest(&self) -> Self::State {
        (self.fresh)()
    }

    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        state.step(input)
    }
}

/// State of an [`AnyObserver`].
pub(super) trait ObserverState<const N: usize>: Send {
    fn reset_to(&mut self, q: &[f64; N], v: &[f64; N]);
    fn resume(&mut self, sample: &Sample<N>, v: &[f64; N]) -> [f64; N];
    fn step(&mut self, sample: &Sample<N>) -> [f64; N];
}

impl<const N: usize, O: VelocityObserver<N> + Send + Sync> ObserverState<N> for Pair<O, O::State>
where
    O::State: Send,
{
    fn reset_to(&mut self, q: &[f64; N], v: &[f64; N]) {
        self.numbers.reset_to(&mut self.state, q, v);
    }

    fn resume(&mut self, sample: &Sample<N>, v: &[f64; N]) -> [f64; N] {
        self.numbers.resume(&mut self.state, sample, v)
    }

    fn step(&mut self, sample: &Sample<N>) -> [f64; N] {
        self.numbers.step(&mut self.state, sample)
    }
}

/// A velocity observer of any kind.
pub(super) struct AnyObserver<const N: usize> {
    fresh: Fresh<dyn ObserverState<N>>,
    shown: Shown,
}

impl<const N: usize> fmt::Debug for AnyObserver<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.shown.fmt(f)
    }
}

impl<const N: usize> AnyObserver<N> {
    pub(super) fn new<O: VelocityObserver<N> + fmt::Debug + Send + Sync + 'static>(observer: O) -> Self
    where
        O::State: Send + 'static,
    {
        let numbers = Arc::new(observer);
        let shown: Shown = numbers.clone();
        Self { shown, fresh: Box::new(move || Box::new(Pair { state: numbers.at_rest(), numbers: Arc::clone(&numbers) })) }
    }
}

impl<const N: usize> VelocityObserver<N> for AnyObserver<N> {
    type State = Box<dyn ObserverState<N>>;

    fn at_rest(&self) -> Self::State {
        (self.fresh)()
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        state.reset_to(q, v);
    }

    fn resume(&self, state: &mut Self::State, sample: &Sample<N>, v: &[f64; N]) -> [f64; N] {
        state.resume(sample, v)
    }

    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        state.step(sample)
    }
}

/// State of an [`AnyTask`].
pub(super) trait TaskState<const N: usize, const M: usize>: Send {
    fn at(&mut self, q: &[f64; N]) -> Option<Task<N, M>>;
    fn drives(&mut self, x: &[f64; M]) -> Option<[f64; N]>;
}

impl<const N: usize, const M: usize, K: TaskMap<N, M> + Send + Sync> TaskState<N, M> for Pair<K, K::State>
where
    K::State: Send,
{
    fn at(&mut self, q: &[f64; N]) -> Option<Task<N, M>> {
        self.numbers.at(&mut self.state, q)
    }

    fn drives(&mut self, x: &[f64; M]) -> Option<[f64; N]> {
        self.numbers.drives(&mut self.state, x)
    }
}

/// The forces on a task.
type Forces<const N: usize, const M: usize> = Box<dyn Fn(&Input<N>, &Task<N, M>) -> [[f64; M]; 2] + Send + Sync>;

/// A task map of any kind.
pub(super) struct AnyTask<const N: usize, const M: usize> {
    fresh: Fresh<dyn TaskState<N, M>>,
    forces: Forces<N, M>,
    shown: Shown,
}

impl<const N: usize, const M: usize> fmt::Debug for AnyTask<N, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.shown.fmt(f)
    }
}

impl<const N: usize, const M: usize> AnyTask<N, M> {
    pub(super) fn new<K: TaskMap<N, M> + fmt::Debug + Send + Sync + 'static>(map: K) -> Self
    where
        K::State: Send + 'static,
    {
        let numbers = Arc::new(map);
        let known = Arc::clone(&numbers);
        let shown: Shown = numbers.clone();
        Self {
            shown,
            fresh: Box::new(move || Box::new(Pair { state: numbers.at_rest(), numbers: Arc::clone(&numbers) })),
            forces: Box::new(move |input, task| known.forces(input, task)),
        }
    }
}

impl<const N: usize, const M: usize> TaskMap<N, M> for AnyTask<N, M> {
    type State = Box<dyn TaskState<N, M>>;

    fn at_rest(&self) -> Self::State {
        (self.fresh)()
    }

    fn at(&self, state: &mut Self::State, q: &[f64; N]) -> Option<Task<N, M>> {
        state.at(q)
    }

    fn drives(&self, state: &mut Self::State, x: &[f64; M]) -> Option<[f64; N]> {
        state.drives(x)
    }

    fn forces(&self, input: &Input<N>, task: &Task<N, M>) -> [[f64; M]; 2] {
        (self.forces)(input, task)
    }
}
