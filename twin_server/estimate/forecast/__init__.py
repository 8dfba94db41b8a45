"""Past changes and known events in; forecasts of the changes out."""
