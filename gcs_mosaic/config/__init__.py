"""All settings in one tree, read from YAML.

Each room defines its own settings and defaults; `tree` assembles them, `settings_file` reads them; `model_trial` tries the file
of a learned model that they name. May import the rooms' settings; called by `app` and `cli`.
"""
