"""The operator's seat: starts processes, records what they do, prices and shows it.

It comes before all other packages of ours, so that their names mean these packages: see `fleet/packages.py`.
"""

from fleet.packages import claim

claim()
