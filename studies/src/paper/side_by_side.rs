//! Tables in which the generations of controllers stand side by side.

use mishandle::Plan;
use mishandle_report::{Block, NOTHING, Table};

use crate::{GENERATIONS, Generation};

/// Returns the algorithm of a controller and its generation. A controller of no generation, such as
/// an expert or a file, stands in the place of the first.
pub(crate) fn algorithm(controller: &str) -> (&str, &'static Generation) {
    Generation::of(controller).unwrap_or_else(|| (controller, Generation::of_paper()))
}

/// A row: runs whose plans differ in the generation of the controller alone, and in the numbers of
/// trials or episodes, which the cells state.
pub(crate) struct Row<T> {
    /// The plan of the first of them, with the algorithm as the controller.
    pub plan: Plan,
    /// One for each generation; `None` if the campaign has no such run.
    sides: Vec<Option<T>>,
}

/// A kind of columns.
#[derive(Clone)]
pub(crate) enum Column<T> {
    /// One column for the row.
    Row(&'static str, fn(&Row<T>) -> String),
    /// One column for each generation.
    Each(&'static str, fn(&T) -> String),
}

/// Rows, and the generations that they have.
pub(crate) struct SideBySide<T> {
    pub rows: Vec<Row<T>>,
    generations: Vec<&'static Generation>,
}

/// Returns a plan without its numbers of trials and episodes.
fn without_size(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    if let Some(falsify) = &mut plan.falsify {
        falsify.trials = 0;
    }
    if let Some(evaluate) = &mut plan.evaluate {
        evaluate.episodes = 0;
    }
    plan
}

impl<T> Row<T> {
    /// Returns the run of the generation that the paper's values are compared with.
    pub fn of_paper(&self) -> Option<&T> {
        let sides = GENERATIONS.iter().zip(&self.sides);
        sides.filter(|(generation, _)| generation.is_of_paper).find_map(|(_, side)| side.as_ref())
    }

    /// Returns whether a run satisfies a condition.
    pub fn any(&self, holds: impl Fn(&T) -> bool) -> bool {
        self.sides.iter().flatten().any(holds)
    }

    /// Returns the runs of these generations; `None` if one is missing.
    pub fn all(&self, generations: &[&'static Generation]) -> Option<Vec<&T>> {
        generations.iter().map(|generation| self.sides[place(generation)].as_ref()).collect()
    }
}

impl<T> SideBySide<T> {
    /// Sorts runs into rows. A row stands where its first run does. Plans that occur twice are in
    /// two rows.
    pub fn new<'a>(runs: impl Iterator<Item = (&'a Plan, T)>) -> SideBySide<T> {
        let mut rows: Vec<Row<T>> = Vec::new();
        let mut present = [false; GENERATIONS.len()];
        for (plan, run) in runs {
            let (algorithm, generation) = algorithm(&plan.controller);
            let plan = Plan { controller: algorithm.to_string(), ..plan.clone() };
            let place = place(generation);
            present[place] = true;
            let is_free = |row: &&mut Row<T>| {
                row.sides[place].is_none() && without_size(&row.plan) == without_size(&plan)
            };
            match rows.iter_mut().find(is_free) {
                Some(row) => row.sides[place] = Some(run),
                None => {
                    let mut sides: Vec<Option<T>> = GENERATIONS.iter().map(|_| None).collect();
                    sides[place] = Some(run);
                    rows.push(Row { plan, sides });
                }
            }
        }
        let generations = GENERATIONS.iter().zip(present).filter(|(_, is_present)| *is_present);
        SideBySide { rows, generations: generations.map(|(generation, _)| generation).collect() }
    }

    /// Returns the generations of the rows.
    pub fn generations(&self) -> &[&'static Generation] {
        &self.generations
    }

    /// Returns a table with a row for each row that `is_shown` accepts. If all runs are of the
    /// paper's generation, the columns do not name it.
    pub fn table(
        &self,
        caption: String,
        left: usize,
        columns: &[Column<T>],
        is_shown: impl Fn(&Row<T>) -> bool,
    ) -> Table {
        let of_all = |column: &Column<T>| match column {
            Column::Row(name, _) => vec![name.to_string()],
            Column::Each(name, _) => {
                let named = |generation: &&Generation| match self.generations[..] {
                    [one] if one.is_of_paper => name.to_string(),
                    _ => format!("{name}, {}", generation.name),
                };
                self.generations.iter().map(named).collect()
            }
        };
        let cells = |row: &Row<T>| {
            let of_column = |column: &Column<T>| match column {
                Column::Row(_, show) => vec![show(row)],
                Column::Each(_, show) => {
                    let of = |generation: &&Generation| {
                        row.sides[place(generation)].as_ref().map_or(NOTHING.to_string(), show)
                    };
                    self.generations.iter().map(of).collect()
                }
            };
            columns.iter().flat_map(of_column).collect()
        };
        Table {
            caption,
            columns: columns.iter().flat_map(of_all).collect(),
            left,
            rows: self.rows.iter().filter(|row| is_shown(row)).map(cells).collect(),
        }
    }

    /// Says how the generations were trained and which one the paper's values are compared with;
    /// nothing if all runs are of the paper's generation.
    pub fn protocols(&self) -> Vec<Block> {
        if self.generations.iter().all(|generation| generation.is_of_paper) {
            return Vec::new();
        }
        let protocol = |generation: &Generation| {
            let follows = if generation.is_of_paper {
                "the paper's protocol, so the comparison with the paper is that of this generation"
            } else {
                "another protocol than the paper's, so its values stand beside the paper's without a comparison"
            };
            let Generation { name, suffix, training, .. } = generation;
            format!("{name} generation (`ppo{suffix}`): {training}; {follows}.")
        };
        let list = GENERATIONS.iter().map(protocol);
        let place = "`expert` and controllers of no generation stand in the columns of the first.";
        vec![Block::List(list.chain([place.to_string()]).collect())]
    }
}

/// Returns the position of a generation in [`GENERATIONS`].
fn place(generation: &Generation) -> usize {
    GENERATIONS.iter().position(|known| known == generation).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle::plan::{EvaluatePlan, FalsifyPlan};

    fn plan(controller: &str) -> Plan {
        Plan::new("ball-pushing", controller)
    }

    /// The values of the runs are their numbers.
    fn table(controllers: &[&str]) -> (Vec<String>, Vec<String>) {
        let plans: Vec<Plan> = controllers.iter().map(|name| plan(name)).collect();
        let rows = SideBySide::new(plans.iter().zip(1..));
        let columns = [
            Column::Row("controller", |row| row.plan.controller.clone()),
            Column::Each("n", |n: &i32| n.to_string()),
            Column::Row("paper", |row| row.of_paper().map_or("none".to_string(), i32::to_string)),
        ];
        let table = rows.table("Numbers".to_string(), 1, &columns, |_| true);
        (table.columns, table.rows.iter().map(|row| row.join(" ")).collect())
    }

    #[test]
    fn generations_stand_side_by_side() {
        let (columns, rows) = table(&["ppo", "trpo", "expert", "./ppo-2.onnx", "ppo-2", "ddpg-2"]);
        assert_eq!(columns, ["controller", "n, first", "n, second", "paper"]);
        let expected = ["ppo 1 5 1", "trpo 2 - 2", "expert 3 - 3", "./ppo-2.onnx 4 - 4", "ddpg - 6 none"];
        assert_eq!(rows, expected);
    }

    #[test]
    fn one_generation_is_named_unless_it_is_that_of_the_paper() {
        assert_eq!(table(&["ppo"]).0, ["controller", "n", "paper"]);
        assert_eq!(table(&["ppo-2"]).0, ["controller", "n, second", "paper"]);
    }

    #[test]
    fn numbers_of_trials_and_episodes_may_differ() {
        let of = |name: &str, episodes, trials| Plan {
            evaluate: Some(EvaluatePlan { episodes, ..EvaluatePlan::default() }),
            falsify: Some(FalsifyPlan { trials, ..FalsifyPlan::default() }),
            ..plan(name)
        };
        let all = [of("ppo", 1000, 30), of("ppo-2", 100, 5)];
        let found = SideBySide::new(all.iter().zip(1..));
        let both = found.rows.iter().map(|row| row.all(&GENERATIONS.iter().collect::<Vec<_>>()));
        assert_eq!(both.collect::<Vec<_>>(), [Some(vec![&1, &2])]);
    }

    #[test]
    fn plans_that_differ_otherwise_or_occur_twice_are_in_rows_of_their_own() {
        let other = Plan { seed: 1, ..plan("ppo-2") };
        let all = [plan("ppo"), other, plan("ppo"), plan("ppo-2")];
        let rows = SideBySide::new(all.iter().zip(1..)).rows;
        let both = rows.iter().map(|row| row.all(&GENERATIONS.iter().collect::<Vec<_>>()));
        assert_eq!(both.collect::<Vec<_>>(), [Some(vec![&1, &4]), None, None]);
    }
}
