//! Relations between pairs of scenarios: names become axes.

use mishandle_falsification::{AxisChange, Cases, MetamorphicSettings, OutputRelation, Relation};
use mishandle_rollout::{Axis, Seed, Space};

use crate::error::MishandleError;
use crate::plan::{MetamorphicPlan, RelationPlan};
use crate::resolve::{ResolvedPlan, with_settings};

/// Source cases, relations and settings of a metamorphic test.
#[derive(Clone, Debug)]
pub struct MetamorphicCases {
    /// Source cases and their follow-up cases.
    pub cases: Cases,
    /// The relations, in the order of their names.
    pub relations: Vec<Relation>,
    /// Numbers of pairs and of simulations per batch.
    pub settings: MetamorphicSettings,
}

impl MetamorphicCases {
    /// Resolves the relations of a plan. `sources` is the space of the source cases and `known` the
    /// axes of the target.
    ///
    /// # Errors
    /// If the name of an axis, a change or what must hold is invalid.
    pub fn new(
        table: &MetamorphicPlan,
        sources: Space,
        known: &[Axis],
        seed: Seed,
    ) -> Result<MetamorphicCases, MishandleError> {
        let space = space_of_both(table, &sources, known)?;
        let relation = |(name, relation): (&String, &RelationPlan)| {
            let change = |(axis, text): (&String, &String)| {
                let index = space.axes().iter().position(|other| other.name == *axis);
                let change: AxisChange = text.parse()?;
                Ok((index.ok_or_else(|| unknown(axis, known))?, change))
            };
            let changes = relation.change.iter().map(change).collect::<Result<_, MishandleError>>()?;
            let holds: OutputRelation = relation.holds.parse()?;
            Ok(Relation { name: name.clone(), changes, holds })
        };
        let relations = table.relations.iter().map(relation).collect::<Result<_, MishandleError>>()?;
        let settings = MetamorphicSettings { pairs: table.pairs, batch: table.batch as usize };
        Ok(MetamorphicCases { cases: Cases::new(sources, space, seed), relations, settings })
    }

    /// Checks the relations: see [`Cases::check`].
    ///
    /// # Errors
    /// If a relation cannot be tested.
    pub fn check(&self) -> Result<(), MishandleError> {
        Ok(self.cases.check(&self.relations, self.settings)?)
    }
}

/// Returns the source cases and relations of a plan.
///
/// # Errors
/// If the plan has no table `[metamorphic]`, or a name in it is invalid.
pub fn metamorphic_cases(resolved: &ResolvedPlan) -> Result<MetamorphicCases, MishandleError> {
    let ResolvedPlan { plan, target, .. } = resolved;
    let table = plan.metamorphic.as_ref().ok_or(MishandleError::MissingPlanTable { table: "metamorphic" })?;
    let sources = with_settings(target.space(&plan.space)?, &plan.axes, &target.axes)?;
    MetamorphicCases::new(table, sources, &target.axes, Seed(plan.seed))
}

/// Returns the space of source cases and follow-up cases: a changed axis has all values that the
/// target allows, also if the source cases have only some of them, or none.
///
/// # Errors
/// If no axis of `known` has the name of a changed one.
pub(super) fn space_of_both(
    table: &MetamorphicPlan,
    sources: &Space,
    known: &[Axis],
) -> Result<Space, MishandleError> {
    let mut axes = sources.axes().to_vec();
    for name in table.relations.values().flat_map(|relation| relation.change.keys()) {
        let whole = known.iter().find(|axis| axis.name == *name).ok_or_else(|| unknown(name, known))?;
        match axes.iter_mut().find(|axis| axis.name == *name) {
            Some(axis) => *axis = Axis { nominal: axis.nominal, ..whole.clone() },
            None => axes.push(whole.clone()),
        }
    }
    Ok(Space::new(sources.name(), axes)?)
}

fn unknown(name: &str, known: &[Axis]) -> MishandleError {
    let known = known.iter().map(|axis| axis.name.clone()).collect();
    MishandleError::UnknownName { kind: "axis", name: name.to_string(), known }
}
