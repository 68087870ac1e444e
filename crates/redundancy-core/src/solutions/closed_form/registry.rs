//! Which closed form an arm has: one row each.

use std::sync::Arc;

use super::form::ClosedForm;
use super::panda_class::PandaClassArm;
use super::parallel_axes::ParallelAxesArm;
use super::spherical_wrist::SphericalWristArm;
use super::srs::SrsArm;
use crate::chain::Chain;

/// Recognises an arm by its geometry.
type Recognise = fn(&Chain) -> Option<Arc<dyn ClosedForm>>;

/// Every closed form, asked in this order.
const FORMS: [Recognise; 4] = [
    |chain| Some(Arc::new(SphericalWristArm::new(chain).ok()?)),
    |chain| Some(Arc::new(ParallelAxesArm::new(chain).ok()?)),
    |chain| Some(Arc::new(SrsArm::new(chain).ok()?)),
    |chain| Some(Arc::new(PandaClassArm::new(chain).ok()?)),
];

/// The closed form of `chain`; `None` where it has none that is known.
pub fn closed_form(chain: &Chain) -> Option<Arc<dyn ClosedForm>> {
    FORMS.iter().find_map(|recognise| recognise(chain))
}
