//! Training algorithms: environments in, controllers out.
