"""All settings in one tree, read from YAML.

Each room has its own settings and their defaults; `tree` puts them together, `settings_file` reads them. May import the rooms'
settings; called by `app` and `cli`.
"""
