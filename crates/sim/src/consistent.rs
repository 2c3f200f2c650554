//! A motion of robots with more drives than freedoms: the surplus drives go where the loops take them.

use core::cell::RefCell;

use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::model::Model;

use crate::error::SimError;
use crate::plant::check;
use crate::reference::Sample;
use crate::trajectory::Trajectory;

/// A motion whose surplus drives follow from the others by the loops.
pub struct Consistent<'m> {
    model: &'m Model,
    /// The same robot with as many drives as it has freedoms, the first ones: met in the mean, the rates of all would not be those of the
    /// positions.
    leading: Model,
    inner: Box<dyn Trajectory>,
    data: RefCell<Data>,
}

/// Whether the robot has more drives than freedoms.
#[must_use]
pub fn has_surplus_drives(model: &Model) -> bool {
    model.n_act() > Data::new(model).n_ind()
}

/// The same robot with as many drives as it has freedoms, the first ones.
pub(crate) fn leading(model: &Model) -> Model {
    let mut leading = model.clone();
    leading.actuators.truncate(Data::new(model).n_ind());
    leading
}

impl<'m> Consistent<'m> {
    /// `inner` on `model`; of it only the motion of as many drives as there are freedoms is kept, the first ones.
    ///
    /// # Errors
    /// Loops that do not close where the motion begins.
    pub fn try_new(model: &'m Model, inner: Box<dyn Trajectory>) -> Result<Self, SimError> {
        let leading = leading(model);
        let (mut data, mut sample) = (Data::new(&leading), Sample::default());
        inner.at(0.0, &mut sample);
        sample.q.truncate(leading.n_act());
        for closure in [assemble(&leading, &mut data), walk_to(&leading, &mut data, &sample.q)] {
            check(&closure, 0.0)?;
        }
        Ok(Self { model, leading, inner, data: RefCell::new(data) })
    }
}

impl Trajectory for Consistent<'_> {
    fn at(&self, t: f64, out: &mut Sample) {
        self.inner.at(t, out);
        let data = &mut *self.data.borrow_mut();
        let n = self.leading.n_act();
        // A motion may be one of the leading drives alone.
        [&mut out.q, &mut out.v, &mut out.a].into_iter().for_each(|x| x.resize(self.model.n_act(), 0.0));
        let is_closed = closed_loop_motion(&self.leading, data, &out.q[..n], &out.v[..n], &out.a[..n]).is_closed;
        for (k, &j) in self.model.actuators.iter().enumerate() {
            // Where loops do not close there is no motion: whoever follows it finds no number.
            let motion = [data.q[j], data.v[j], data.a[j]].map(|x| if is_closed { x } else { f64::NAN });
            [out.q[k], out.v[k], out.a[k]] = motion;
        }
    }
}
