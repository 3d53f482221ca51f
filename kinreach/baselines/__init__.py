"""Policies, how they are trained, and how they are evaluated.

- `policies`: networks in numpy, policy files, `load_policy`; `sb3_zip`: stable-baselines3's `model.zip`.
- `rollout`, `evaluation`: the loop between a policy and an environment, and what is measured.
- `recipes`, `algorithms`, `networks`, `rewards`: what is trained, and with what; others register theirs.
- `batch`, `vec_envs`, `learning_curve`: environments as learners see them.
- `models`, `training`: from a recipe to a model, and to a finished run; `logs` are those that come with the package.

The loop (`rollout`) knows environments only through Gymnasium's interface; policies, recipes, controllers and batches
take the data of their tasks from `kinreach.envs`. What trains needs the extra `train`; what acts does not.
"""
